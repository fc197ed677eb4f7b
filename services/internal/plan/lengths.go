package plan

import (
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/tally"
)

// lengthFloor is the share of the large steps that is spread evenly over all lengths that can carry
// light: the bootstrap may have missed what is rare.
const lengthFloor = 0.1

// SetLengths fixes the probability of large steps to draw each path length, in proportion to the
// length's share of b with a floor, unless the spec has them already (a repeated job).
func SetLengths(spec *jobv1.ResolvedSpec, lengths []tally.Sums, report *scenev1.SceneReport) {
	if len(spec.GetLengthProbabilities()) > 0 {
		return
	}
	possible, total := 0, 0.0
	for k, s := range lengths {
		total += s.Mean()
		if !impossible(k+1, s, report) {
			possible++
		}
	}
	probabilities := make([]float64, len(lengths))
	for k, s := range lengths {
		switch {
		case impossible(k+1, s, report):
		case total > 0:
			probabilities[k] = (1-lengthFloor)*s.Mean()/total + lengthFloor/float64(possible)
		default:
			probabilities[k] = 1 / float64(possible)
		}
	}
	spec.LengthProbabilities = probabilities
}

// impossible tells whether paths of so many edges cannot carry light, and have not: a path of one
// edge ends on a light that a ray can hit and that is to be seen.
func impossible(edges int, s tally.Sums, report *scenev1.SceneReport) bool {
	structure := report.GetStructure()
	unseen := structure.GetExtendedLights() == 0 || structure.GetHideEmitters()
	return edges == 1 && structure != nil && unseen && s.Sum == 0
}
