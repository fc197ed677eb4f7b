package plan

import (
	"fmt"
	"slices"

	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// The pilot of integrator auto: one path-traced sample per pixel within these bounds, spread over
// the whole film, with a seed of its own so that its choice does not depend on what is rendered. It
// is taken twice, the second time with paths of one edge: the difference, sample by sample, is the
// light that is not seen directly. A lamp in the image is bright and small, but not hard.
const (
	minPilot  = 16384
	maxPilot  = 65536
	pilotSeed = 0x70696c6f74 // mixed into the job's seed
)

// The rule, from the pilot's counts alone, about light that is not seen directly:
//   - no sample carries any: what there is is hard to find, chains look for it;
//   - the brightest thousandth of the samples carries more than hardTopShare of it: a few paths make
//     the image, so path tracing leaves sparks and chains follow what they have found;
//   - else path tracing, whose samples are cheaper and stratified.
//
// Chains run over path tracing with MIS; where more than darkShare of the samples carry nothing,
// light subpaths find what eye paths miss, and the chains are those of mmlt.
//
// Top shares of 16384 samples, November 2026: boxes lit by a lamp 0.007 to 0.017, Veach's MIS plates
// 0.10 and 0.30, his bidirectional room 0.12, ring caustic 0.11, glass caustic 0.16, light through a
// door ajar 0.20 and 0.38, plates and lights 0.41. Benchmarks of error against cost are to revise
// the constants.
const (
	topPart      = 1000 // the brightest one in so many
	hardTopShare = 0.1
	darkShare    = 0.95
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

// Seen is the pilot's spec for its second pass, or false if its paths have one edge anyway.
func Seen(pilot *jobv1.ResolvedSpec) (*jobv1.ResolvedSpec, bool) {
	spec := proto.CloneOf(pilot)
	spec.MaxDepth = 1
	return spec, pilot.GetMaxDepth() != 1
}

// Decide chooses the integrator from the pilot's values of f and from those of the light seen
// directly.
func Decide(values, seen []float32, report *scenev1.SceneReport) (integrator string, d *jobv1.AutoDecision) {
	d = measure(unseen(values, seen))
	top, dark := 100*d.TopShare, 100*d.ZeroShare
	switch {
	case d.ZeroShare == 1:
		d.Reason = "no pilot sample carries light that is not seen directly: chains look for it"
		return chainsFor(d, report), d
	case d.TopShare > hardTopShare:
		d.Reason = fmt.Sprintf("a thousandth of the samples carries %.1f %% of the light not seen directly, more than %.0f %%, and %.1f %% are dark: chains follow the light",
			top, 100*hardTopShare, dark)
		return chainsFor(d, report), d
	}
	d.Reason = fmt.Sprintf("a thousandth of the samples carries %.1f %% of the light not seen directly, at most %.0f %%: independent paths suffice",
		top, 100*hardTopShare)
	return job.IntegratorPath, d
}

// unseen is the light of each sample that is not seen directly.
func unseen(values, seen []float32) []float32 {
	const rounding = 1e-5 // of the two sums of float
	rest := make([]float32, len(values))
	for i, v := range values {
		if r := v - seen[i]; r > rounding*v {
			rest[i] = r
		}
	}
	return rest
}

// chainsFor chooses what chains a hard scene gets.
func chainsFor(d *jobv1.AutoDecision, report *scenev1.SceneReport) string {
	structure := report.GetStructure()
	reachable := structure.GetDeltaShapes() < structure.GetShapes() // light subpaths can connect somewhere
	if d.GetZeroShare() > darkShare && reachable {
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
