package coordinator

import (
	"fmt"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// stage of a job between inspection and rendering. A job passes them in this order and leaves out
// what it does not need.
type stage int

const (
	stageLight     stage = iota // where the scene's light lands
	stagePilot                  // how samples scatter about that, by which the integrator is chosen
	stageMap                    // where light lands, for the equalized target
	stageBootstrap              // b and the seeds
	stageTrials                 // how small steps of several sizes fare
)

// stageNames in task names.
var stageNames = [...]string{"light-", "pilot-", "map-", "b", "trials"}

// piloting tells whether the integrator is still to be chosen. Requires: mu.
func (r *run) piloting() bool { return r.spec != nil && r.state == nil && r.stage < stageMap }

// plan resolves the spec, or says how to find out what to resolve. Requires: mu.
func (r *run) plan(report *scenev1.SceneReport) (*jobv1.ResolvedSpec, []string, error) {
	if plan.NeedsPilot(r.rec.Request, report) {
		r.stage = stageLight
		spec, err := plan.Pilot(r.rec.Request, report)
		if err == nil {
			err = r.c.options.Limits.Check(spec, r.rec.Request, report)
		}
		return spec, nil, err
	}
	spec, warnings, err := r.resolve(r.rec.Request, report)
	if err == nil {
		r.enterResolved(spec, r.rec.Request)
	}
	return spec, warnings, err
}

// resolve the spec and check that it takes no more than a job may.
func (r *run) resolve(request job.Request, report *scenev1.SceneReport) (*jobv1.ResolvedSpec, []string, error) {
	spec, warnings, err := plan.Resolve(request, report)
	if err == nil {
		err = r.c.options.Limits.Check(spec, request, report)
	}
	return spec, warnings, err
}

// enterResolved sets the stage in which a job goes on once its spec is resolved from a request.
// Requires: mu.
func (r *run) enterResolved(spec *jobv1.ResolvedSpec, request job.Request) {
	r.stage = stageBootstrap
	if plan.NeedsMap(spec, request) {
		r.stage = stageMap
	}
}

// mapping tells whether the samples of the stage under way tell where light lands. Requires: mu.
func (r *run) mapping() bool {
	return r.rec.State == job.Bootstrapping && (r.stage == stageLight || r.stage == stageMap)
}

// stageSpec is what the tasks of the stage under way are done under. Requires: mu.
func (r *run) stageSpec() *jobv1.ResolvedSpec {
	if r.mapping() {
		return plan.MapPilot(r.spec)
	}
	return r.spec
}

// startSampling opens the tasks of a stage that evaluates independent samples. Requires: mu; spec is
// resolved.
func (r *run) startSampling() {
	r.clearTasks()
	r.samples = bootstrap.NewSamples(r.spec.GetBootstrapSamples())
	for i, part := range plan.BootstrapRanges(r.spec) {
		id := fmt.Sprintf("%s/%s%d", r.id, stageNames[r.stage], i)
		r.put(id, uint64(i), taskKey{phase: job.Bootstrapping, first: part})
	}
}

// nextStage goes on when all samples of a stage are in. Requires: mu.
func (r *run) nextStage() {
	switch r.stage {
	case stageLight:
		r.target()
		r.stage = stagePilot
		r.startSampling()
	case stagePilot:
		r.decide()
	case stageMap:
		r.target()
		if r.spec.GetTargetMap() == nil {
			r.warn("no sample of the map carries light: the target is luminance")
		}
		r.stage = stageBootstrap
		r.startSampling()
	default:
		r.finishBootstrap()
	}
}

// target sets the target from where the samples landed. Requires: mu; all samples are in.
func (r *run) target() {
	r.spec = proto.CloneOf(r.spec)
	plan.SetTarget(r.spec, r.samples.Map())
}

// decide chooses what the request leaves open from the pilot's samples and goes on. Requires: mu;
// all samples are in.
func (r *run) decide() {
	request, decision := plan.Decide(r.rec.Request, r.spec, r.samples.Values(), r.report)
	spec, warnings, err := r.resolve(request, r.report)
	if err != nil {
		r.fail(err.Error())
		return
	}
	spec.WorkerVersion, spec.AutoDecision = r.spec.GetWorkerVersion(), decision
	r.spec = spec
	r.enterResolved(spec, request)
	for _, text := range warnings {
		r.warn(text)
	}
	r.publish("state", fmt.Sprintf("integrator %s: %s", request.Integrator, decision.GetReason()), nil)
	r.clearTasks()
	r.whenThereIsRoom(func() { // its film may have more layers than the pilot's
		if r.rec.State == job.Queued {
			r.setState(job.Bootstrapping, "")
		}
		r.startSampling()
	})
	r.save()
}

// finishBootstrap fixes the film unit and the seeds. Requires: mu; all samples are in.
func (r *run) finishBootstrap() {
	halves := [film.Halves]tally.Sums{r.samples.Half(0), r.samples.Half(1)}
	mean, _ := bootstrapB(halves)
	spec := proto.CloneOf(r.spec)
	r.spec = spec
	dark := halves[0].Sum == 0 || halves[1].Sum == 0
	if dark && plan.DirectApart(spec) {
		// A half without seeds has no segments, which would leave its share of the direct light out.
		r.warn("a bootstrap half carries no light that bounces twice: the chains carry direct light, too")
		spec.DirectSizes = nil
		r.startSampling()
		return
	}
	warning, black := plan.SetUnit(spec, mean)
	if warning != "" {
		r.warn(warning)
	}
	var lengths []tally.Sums
	if plan.Multiplexed(spec) {
		lengths = r.samples.Lengths(int(spec.GetMaxDepth()))
		plan.SetLengths(spec, lengths, r.report)
	}
	r.boot = bootstrapped{halves: halves, lengths: lengths}
	switch {
	case black:
		r.endBlack()
		return
	case plan.Chains(spec) == 0:
		r.render()
		return
	}
	r.boot.seeds = r.samples.Seeds(spec.GetSeed(), int(spec.GetChainGroups()), int(spec.GetGroupSize()))
	for h, half := range halves {
		if half.Sum == 0 {
			r.warn(fmt.Sprintf("bootstrap half %d carries no light: its half of the image stays black; more bootstrap samples may help", h))
		}
	}
	if plan.NeedsTrials(spec, r.rec.Request) {
		r.startTrials()
		return
	}
	r.render()
}

// bootstrapped is what the bootstrap leaves to rendering.
type bootstrapped struct {
	halves  [film.Halves]tally.Sums
	lengths []tally.Sums
	seeds   [][]bootstrap.Seed
}

// render leaves the preparation. Requires: mu; the spec is complete but for the worker's version.
func (r *run) render() {
	boot := r.boot
	r.samples, r.boot = nil, bootstrapped{}
	r.clearTasks()
	r.startRendering(boot.halves, boot.seeds)
	r.state.Lengths = boot.lengths
	r.save()
	r.c.wake()
}

// endBlack ends a job of chains that have nothing to start from. Requires: mu.
func (r *run) endBlack() {
	r.boot.seeds = make([][]bootstrap.Seed, r.spec.GetChainGroups())
	r.render()
	r.clearTasks()
	r.state.Drop()
	r.emptySHA, _ = r.state.FilmSHA256() // writing to a hash cannot fail
	r.finishing = &round.Decision{Round: -1, Reason: round.StopBlack}
	r.save()
	r.c.wake()
}

// startTrials opens the one task that tries kernels, from the seeds of a group that has some.
// Requires: mu.
func (r *run) startTrials() {
	r.stage = stageTrials
	r.clearTasks()
	r.put(fmt.Sprintf("%s/%s", r.id, stageNames[r.stage]), 0, taskKey{phase: job.Bootstrapping})
	r.save()
	r.c.wake()
}

// trialsTask requires: mu.
func (r *run) trialsTask() *farmv1.KernelTrialsTask {
	group := 0
	for len(r.boot.seeds[group]) == 0 {
		group++
	}
	kernels, _ := plan.TrialKernels(r.spec)
	return &farmv1.KernelTrialsTask{
		Kernels: kernels, Mutations: plan.TrialMutations, Group: seedState(group, r.boot.seeds[group]),
	}
}

// tried takes the counts of the kernels and goes on to rendering. Requires: mu.
func (r *run) tried(w worker, l *farmv1.LeaseRef, result *farmv1.KernelTrialsResult) error {
	kernels, _ := plan.TrialKernels(r.spec)
	if len(result.GetTrials()) != len(kernels) {
		return &malformedError{fmt.Sprintf("%d trials of %d kernels", len(result.GetTrials()), len(kernels))}
	}
	cpu, err := r.cpuTime(w, result.GetCpuSeconds(), l)
	if err != nil {
		return err
	}
	for _, t := range result.GetTrials() {
		if t.GetSmallAccepted() > t.GetSmallSteps() || t.GetSmallSteps() > t.GetMutations() {
			return &malformedError{"a trial accepted more steps than it made"}
		}
		r.extra.BootstrapEvaluations += t.GetPathEvaluations()
		r.extra.BootstrapRays += t.GetRays()
	}
	r.chargeBootstrap(cpu)
	r.closeTask(l.GetTaskId())
	spec := proto.CloneOf(r.spec)
	plan.SetKernel(spec, result.GetTrials())
	r.spec = spec
	r.publish("state", "kernel: "+spec.GetKernelTuning().GetReason(), nil)
	r.render()
	return nil
}
