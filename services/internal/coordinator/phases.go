package coordinator

import (
	"fmt"
	"log/slog"
	"math"

	"google.golang.org/protobuf/encoding/protojson"
	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/tally"
)

// maxFilterRadius is the bound of SceneReport.filter_radius. It keeps the border, and with it the
// number of cells, within reason.
const maxFilterRadius = 19.5

const (
	// maxWarnings is the bound of SceneReport.warnings.
	maxWarnings = 101
	// maxWarningBytes of each.
	maxWarningBytes = 4096
)

// problemWith says what a well-made worker would not report.
func problemWith(report *scenev1.SceneReport) string {
	if radius := report.GetFilterRadius(); !(radius >= 0 && radius < maxFilterRadius) {
		return fmt.Sprintf("filter radius %v is not in [0, %v)", radius, maxFilterRadius)
	}
	if n := len(report.GetWarnings()); n > maxWarnings {
		return fmt.Sprintf("%d warnings are more than %d", n, maxWarnings)
	}
	return ""
}

// inspected takes a scene report, plans the job and starts the next phase. Requires: mu.
func (r *run) inspected(task string, report *scenev1.SceneReport) error {
	if problem := problemWith(report); problem != "" {
		return &malformedError{problem}
	}
	for i, text := range report.GetWarnings() {
		report.Warnings[i] = clip(text, maxWarningBytes)
	}
	spec, warnings, err := r.plan(report)
	if err != nil {
		r.fail(err.Error())
		return nil
	}
	text, err := protojson.MarshalOptions{UseProtoNames: true, EmitDefaultValues: true}.Marshal(report)
	if err != nil {
		return fmt.Errorf("coordinator: report: %w", err)
	}
	r.rec.SceneReport = string(text)
	encoded, err := proto.Marshal(report)
	if err != nil {
		return fmt.Errorf("coordinator: report: %w", err)
	}
	r.closeTask(task)
	r.report, r.spec, r.extra.Report = report, spec, encoded
	r.extra.LoadSeconds = report.GetLoadSeconds() + report.GetBuildSeconds()
	if math.IsNaN(r.extra.LoadSeconds) || math.IsInf(r.extra.LoadSeconds, 0) {
		r.extra.LoadSeconds = 0
	}
	for _, text := range report.GetWarnings() {
		r.publish("warning", text, nil)
	}
	for _, text := range warnings {
		r.warn(text)
	}
	if r.rec.Request.InspectOnly {
		r.end(job.Done, "the scene was only to be inspected")
		return nil
	}
	r.whenThereIsRoom(r.leaveInspection)
	r.save()
	return nil
}

// leaveInspection starts the phase after it. Requires: mu.
func (r *run) leaveInspection() {
	if !plan.RunsChains(r.spec) && r.spec.GetUnit() > 0 {
		r.startRendering([film.Halves]tally.Sums{}, nil)
		return
	}
	r.startSampling()
	r.setState(job.Bootstrapping, "")
}

// sampled takes the values of one bootstrap range. Requires: mu.
func (r *run) sampled(w worker, l *farmv1.LeaseRef, part plan.Range, result *farmv1.BootstrapResult) error {
	cpu, err := r.cpuTime(w, result.GetCpuSeconds(), l)
	if err != nil {
		return err
	}
	if result.GetFirstIndex() != part.First || len(result.GetValues()) != int(part.Count) {
		return &malformedError{fmt.Sprintf("%d values from index %d, not %d from %d",
			len(result.GetValues()), result.GetFirstIndex(), part.Count, part.First)}
	}
	if len(result.GetAnomalyCounts()) > tally.AnomalyKinds {
		return &malformedError{"too many kinds of anomalies"}
	}
	if err := r.samples.Set(part.First, result.GetValues()); err != nil {
		return &malformedError{err.Error()}
	}
	if r.mapping() {
		if err := r.samples.SetMap(part.First, result.GetMap(), plan.MapSide*plan.MapSide); err != nil {
			return &malformedError{err.Error()}
		}
	}
	r.closeTask(l.GetTaskId())
	r.extra.BootstrapEvaluations += uint64(part.Count)
	r.extra.BootstrapRays += result.GetRays()
	r.chargeBootstrap(cpu)
	for kind, n := range result.GetAnomalyCounts() {
		r.extra.BootstrapAnomalies[kind] += n
	}
	r.reportAnomalies(result.GetAnomalies())
	if r.table.Open() == 0 {
		r.nextStage()
	}
	return nil
}

// chargeBootstrap counts the CPU time of a task before rendering. Requires: mu.
func (r *run) chargeBootstrap(seconds float64) {
	r.extra.BootstrapCPUSeconds += seconds
	r.charge(seconds, 1)
}

// startRendering opens the first rounds. Requires: mu; the spec has its unit.
func (r *run) startRendering(halves [film.Halves]tally.Sums, seeds [][]bootstrap.Seed) {
	r.state = render.New(r.spec, plan.Cells(r.spec, r.report), halves, seeds)
	r.dirty = true
	r.setState(job.Rendering, "")
	r.notePlan()
	r.startClock()
	r.openTasks()
}

// notePlan says what was decided. Requires: mu; rendering.
func (r *run) notePlan() {
	sizes := r.spec.GetRoundSizes()
	attributes := []slog.Attr{
		slog.String("integrator", plan.IntegratorName(r.spec)), slog.Uint64("width", uint64(r.spec.GetWidth())),
		slog.Uint64("height", uint64(r.spec.GetHeight())), slog.Int("segments", len(r.state.Expected())),
		slog.Int("rounds", len(sizes)), slog.Uint64("first_round", sizes[0]), slog.Uint64("last_round", sizes[len(sizes)-1]),
		slog.Float64("unit", r.spec.GetUnit()), slog.Uint64("bootstrap_samples", r.spec.GetBootstrapSamples()),
		slog.String("worker_version", r.spec.GetWorkerVersion()), slog.String("stop", r.rec.Request.Stop.String()),
	}
	if r.state.Chains() {
		b, standardError := bootstrapB(r.state.Bootstrap)
		attributes = append(attributes, slog.Int("chains", plan.Chains(r.spec)), slog.Float64("b", b),
			slog.Float64("b_standard_error", standardError), slog.Bool("direct_apart", plan.DirectApart(r.spec)),
			slog.Bool("equalized", r.spec.GetTargetMap() != nil))
	}
	r.note("planned", attributes...)
}

// reportAnomalies publishes a sample of the contributions that were set to zero. Requires: mu; the
// caller saves or the next save does.
func (r *run) reportAnomalies(anomalies []*farmv1.Anomaly) {
	const shown = 4 // of at most 16 per batch: the counts tell how many there were
	for i, a := range anomalies {
		if i == shown {
			return
		}
		r.publish("anomaly", fmt.Sprintf("%s in %s at depth %d, primary sample %08x",
			a.GetKind(), clip(a.GetPlace(), maxActivity), a.GetDepth(), a.GetPrimarySample()), nil)
	}
}
