package render

import (
	"maps"
	"slices"

	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

// Cut is a round that a stop rule cut short, once the job is to go beyond it: the film has a part of
// the round already, and what is left of it is rendered as that round.
type Cut struct {
	// Size and Direct of the round, of those in the spec, are in the film.
	Size, Direct uint64
	// Point was measured at the cut.
	Point job.ConvergencePoint
}

// Extend goes on under a spec whose rounds are other than so far in nothing but where they end: those
// that a job has which was submitted with another stop rule. A chain's course and a pixel's samples do
// not depend on where rounds end, and what rounds are cut to (plan.CutMultiple) leaves the splats as they
// are, so the film after each round is that job's film. It returns false,
// and changes nothing, if the film has more than these rounds already.
func (s *State) Extend(spec *jobv1.ResolvedSpec) bool {
	old, sizes := s.Spec.GetRoundSizes(), spec.GetRoundSizes()
	last := s.Closed - 1
	switch {
	case s.Closed > len(sizes):
		return false
	case s.Cut != nil && (s.Closed == len(sizes) || s.Cut.Size >= sizes[s.Closed]):
		return false
	case s.Cut != nil || last < 0 || old[last] == sizes[last]:
	case old[last] > sizes[last]:
		return false
	default:
		s.reopen(last)
	}
	for i, o := range s.Open {
		if o.Round >= len(sizes) || o.Round >= len(old) || old[o.Round] != sizes[o.Round] {
			s.Open = s.Open[:i]
			break
		}
	}
	s.Spec = spec
	s.OpenRound(s.Closed)
	return true
}

// reopen makes the round closed last, which was cut short, the one under way. Requires: it was
// rendered under Spec.
func (s *State) reopen(last int) {
	s.Cut = &Cut{Size: s.Spec.GetRoundSizes()[last], Point: s.Points[last]}
	if last < len(s.Spec.GetDirectSizes()) {
		s.Cut.Direct = s.Spec.GetDirectSizes()[last]
	}
	s.Points = slices.Clip(s.Points[:last])
	s.Closed, s.Previous, s.Open = last, nil, nil
}

// History lists the points of the closed rounds, and that of the cut in the round under way if there
// is one: the last describes the film.
func (s *State) History() []job.ConvergencePoint {
	points := slices.Clone(s.Points)
	if s.Cut != nil {
		points = append(points, s.Cut.Point)
	}
	return points
}

// closeCut notes that what was left of the round under way is in the film, too.
func (s *State) closeCut() {
	if s.Cut == nil {
		return
	}
	remainders := make(map[int]uint64)
	maps.Copy(remainders, s.Remainders) // which other snapshots share
	remainders[s.Closed] = s.segmentSize(s.Closed)
	s.Cut, s.Remainders = nil, remainders
}

// segmentSize is the size of the segments of a round: the round's, or what was left of it when it was
// cut.
func (s *State) segmentSize(number int) uint64 {
	size := s.Spec.GetRoundSizes()[number]
	if s.Cut != nil && number == s.Closed { // maybe not for the first time
		return size - s.Cut.Size
	}
	if left, cut := s.Remainders[number]; cut {
		return left
	}
	return size
}

// TaskSpec is what the segments of a round are rendered under: the spec, or, in a round that was cut
// before, the spec with what is left of it.
func (s *State) TaskSpec(number int) *jobv1.ResolvedSpec {
	if s.Cut == nil || number != s.Closed {
		return s.Spec
	}
	spec := proto.CloneOf(s.Spec)
	spec.RoundSizes[number] -= s.Cut.Size
	if number < len(spec.GetDirectSizes()) {
		spec.DirectSizes[number] -= s.Cut.Direct
	}
	return spec
}
