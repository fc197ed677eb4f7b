package plan

import (
	"fmt"
	"slices"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// The pilot of integrator auto: one path-traced sample per pixel within these bounds, spread over
// the whole film, with a seed of its own so that its choice does not depend on what is rendered.
const (
	minPilot  = 16384
	maxPilot  = 65536
	pilotSeed = 0x70696c6f74 // mixed into the job's seed
)

// The rule, from the pilot's counts alone:
//   - no sample carries light: what light there is is hard to find, chains look for it;
//   - the brightest thousandth of the samples carries more than hardTopShare of all light: a few
//     paths make the image, so path tracing leaves sparks and chains follow what they have found;
//   - else path tracing, whose samples are cheaper and stratified.
//
// Chains run over path tracing with MIS; where more than darkShare of the samples carry nothing,
// light subpaths find what eye paths miss, and the chains are those of mmlt. Lights that are seen directly raise the top share without
// making a scene hard: the share of a light as small as a thousandth of the image is below a tenth
// in the scenes measured, those of caustics and of light through a door are above a third.
const (
	topPart      = 1000 // the brightest one in so many
	hardTopShare = 0.25
	darkShare    = 0.95
	// mmltBuilt tells whether workers have it; until then pssmlt stands in.
	mmltBuilt = false
)

// NeedsPilot tells whether the integrator has to be chosen by measuring: the request leaves it open
// and the scene names none that is more than plain path tracing.
func NeedsPilot(r job.Request, report *scenev1.SceneReport) bool {
	open := r.Integrator == "" || r.Integrator == job.IntegratorAuto
	named := slices.Contains([]string{job.IntegratorBDPT, job.IntegratorPSSMLT, job.IntegratorMMLT}, report.GetIntegrator())
	return r.Resolved == "" && open && !named
}

// Pilot is the spec under which bootstrap tasks measure.
func Pilot(r job.Request, report *scenev1.SceneReport) (*jobv1.ResolvedSpec, error) {
	r.Integrator = job.IntegratorPath
	r.BootstrapSamples = 0
	spec, _, err := Resolve(r, report)
	if err != nil {
		return nil, err
	}
	pixels := uint64(spec.GetWidth()) * uint64(spec.GetHeight())
	spec.BootstrapSamples = roundUp(min(max(pixels, minPilot), maxPilot), bootstrapMultiple(spec))
	spec.Seed ^= pilotSeed
	return spec, nil
}

// Decide chooses the integrator from the pilot's values of f.
func Decide(values []float32, report *scenev1.SceneReport) (integrator string, d *jobv1.AutoDecision) {
	d = measure(values)
	top, dark := 100*d.TopShare, 100*d.ZeroShare
	switch {
	case d.ZeroShare == 1:
		d.Reason = "no pilot sample carries light: chains look for it"
		return chainsFor(d, report), d
	case d.TopShare > hardTopShare:
		d.Reason = fmt.Sprintf("a thousandth of the samples carries %.1f %% of the light, more than %.0f %%, and %.1f %% are dark: chains follow the light",
			top, 100*hardTopShare, dark)
		return chainsFor(d, report), d
	}
	d.Reason = fmt.Sprintf("a thousandth of the samples carries %.1f %% of the light, at most %.0f %%: independent paths suffice",
		top, 100*hardTopShare)
	return job.IntegratorPath, d
}

// chainsFor chooses what chains a hard scene gets.
func chainsFor(d *jobv1.AutoDecision, report *scenev1.SceneReport) string {
	structure := report.GetStructure()
	reachable := structure.GetDeltaShapes() < structure.GetShapes() // light subpaths can connect somewhere
	if mmltBuilt && d.GetZeroShare() > darkShare && reachable {
		return job.IntegratorMMLT
	}
	return job.IntegratorPSSMLT
}

func measure(values []float32) *jobv1.AutoDecision {
	d := &jobv1.AutoDecision{PilotSamples: uint64(len(values))}
	n := float64(len(values))
	sum, squares, zeros := 0.0, 0.0, 0
	for _, v := range values {
		sum += float64(v)
		squares += float64(v) * float64(v)
		if v == 0 {
			zeros++
		}
	}
	d.ZeroShare = float64(zeros) / n
	if !(sum > 0) {
		return d
	}
	d.RelativeVariance = squares/n/(sum/n*sum/n) - 1
	sorted := slices.Clone(values)
	slices.Sort(sorted)
	top := 0.0
	for _, v := range sorted[len(sorted)-max(1, len(sorted)/topPart):] {
		top += float64(v)
	}
	d.TopShare = top / sum
	return d
}
