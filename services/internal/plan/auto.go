package plan

import (
	"fmt"
	"slices"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// The pilot of integrator auto: one path-traced sample per pixel within these bounds, spread over
// the whole film, with a seed of its own so that its choice does not depend on what is rendered. It
// is taken twice: the first pass tells where light lands (see MapPilot), the second, with another
// seed, how far its samples scatter about that. A lamp or a highlight in the image is bright, but
// not hard: all samples there are bright.
const (
	minPilot  = 16384
	maxPilot  = 65536
	pilotSeed = 0x70696c6f74 // mixed into the job's seed
)

// The rule, from the second pass's counts alone, about light relative to what the pixel shows. It is
// hard to find where the brightest thousandth of the samples carries more than hardTopShare of it (a
// few paths make the image, so path tracing leaves sparks), or where none carries any.
//   - Light is not hard to find: path tracing, whose samples are cheap and stratified.
//   - It is, in an image of fewer than chainPixels: bidirectional path tracing.
//   - It is, in a larger one: multiplexed chains with the equalized target, and direct light apart.
//     What a chain has found it carries to the pixels around, so its share of the work per pixel
//     falls with the resolution; that of independent samples does not.
//
// Where light subpaths have no surface to connect to, chains run over path tracing instead.
//
// The table behind it is tests/bench/doc/efficiency.md.
const (
	topPart      = 1000 // the brightest one in so many
	sparks       = 2    // of which so many, the brightest, are left out
	hardTopShare = 0.03
	chainPixels  = 1 << 15
)

// NeedsPilot tells whether the integrator has to be chosen by measuring: the request leaves it open
// and the scene names none that is more than plain path tracing.
func NeedsPilot(r job.Request, report *scenev1.SceneReport) bool {
	open := r.Integrator == "" || r.Integrator == job.IntegratorAuto
	named := slices.Contains([]string{job.IntegratorBDPT, job.IntegratorPSSMLT, job.IntegratorMMLT}, report.GetIntegrator())
	return r.Resolved == "" && open && !named
}

// Pilot is the spec under which bootstrap tasks measure; MapPilot is that of the first pass.
func Pilot(r job.Request, report *scenev1.SceneReport) (*jobv1.ResolvedSpec, error) {
	spec, _, err := Resolve(job.Request{
		Integrator: job.IntegratorPSSMLT, LightSampling: r.LightSampling, MaxDepth: r.MaxDepth,
		Width: r.Width, Height: r.Height, Seed: r.Seed ^ pilotSeed,
		ShutterOpen: r.ShutterOpen, ShutterClose: r.ShutterClose, ShutterCurve: r.ShutterCurve,
		ShutterRampOpen: r.ShutterRampOpen, ShutterRampClose: r.ShutterRampClose,
		Exposure: r.Exposure, RollingShutter: r.RollingShutter,
	}, report)
	if err != nil {
		return nil, err
	}
	pixels := uint64(spec.GetWidth()) * uint64(spec.GetHeight())
	spec.BootstrapSamples = roundUp(min(max(pixels, minPilot), maxPilot), bootstrapMultiple(spec))
	return spec, nil
}

// Decide answers what a request leaves open, from the values of f, relative to where light lands, of
// the pilot's second pass.
func Decide(r job.Request, pilot *jobv1.ResolvedSpec, values []float32, report *scenev1.SceneReport) (job.Request, *jobv1.AutoDecision) {
	d := measure(values)
	evidence := fmt.Sprintf("relative to what pixels show, a thousandth of the samples carries %.1f %% of the light", 100*d.TopShare)
	pixels := pilot.GetWidth() * pilot.GetHeight()
	switch {
	case d.ZeroShare == 1:
		evidence = "no pilot sample carries light"
	case d.TopShare <= hardTopShare:
		r.Integrator = job.IntegratorPath
		d.Reason = fmt.Sprintf("%s, at most %.0f %%: independent paths suffice", evidence, 100*hardTopShare)
		return r, d
	default:
		evidence += fmt.Sprintf(", more than %.0f %%", 100*hardTopShare)
	}
	structure := report.GetStructure()
	reachable := structure.GetDeltaShapes() < structure.GetShapes() // light subpaths can connect somewhere
	if pixels < chainPixels && reachable {
		r.Integrator = job.IntegratorBDPT
		d.Reason = fmt.Sprintf("%s: light subpaths look for it; chains would in an image of %d pixels or more", evidence, chainPixels)
		return r, d
	}
	r.Integrator = job.IntegratorPSSMLT
	if reachable {
		r.Integrator = job.IntegratorMMLT
	}
	setDefault(&r.Target, job.TargetEqualized)
	if depth := pilot.GetMaxDepth(); depth < 0 || depth > longestDirect {
		setDefault(&r.DirectApart, job.On)
	}
	d.Reason = evidence + ": chains follow the light"
	return r, d
}

func setDefault(field *string, value string) {
	if *field == "" {
		*field = value
	}
}

func measure(values []float32) *jobv1.AutoDecision {
	d := &jobv1.AutoDecision{PilotSamples: uint64(len(values))}
	n := float64(len(values))
	squares, zeros := 0.0, 0
	for _, v := range values {
		squares += float64(v) * float64(v)
		if v == 0 {
			zeros++
		}
	}
	d.ZeroShare = float64(zeros) / n
	mean := total(values) / n
	if !(mean > 0) {
		return d
	}
	d.RelativeVariance = squares/n/(mean*mean) - 1
	d.TopShare = topShare(values)
	return d
}

// topShare is the share of the brightest thousandth in the sum of the values, the few brightest of
// all left out of both: a spark or two may fly in any scene.
func topShare(values []float32) float64 {
	sorted := slices.Clone(values)
	slices.Sort(sorted)
	top := len(sorted) / topPart
	dropped := min(sparks, top/2)
	bright := sorted[len(sorted)-max(1, top) : len(sorted)-dropped]
	rest := sorted[:len(sorted)-max(1, top)]
	share, all := total(bright), total(rest)+total(bright)
	if all == 0 {
		return 1 // the sparks are all the light there is
	}
	return share / all
}

func total(values []float32) float64 {
	sum := 0.0
	for _, v := range values {
		sum += float64(v)
	}
	return sum
}
