// Package tally adds up what segments report beside splats: counts, and the sums of f and f squared
// that estimate b. It is pure.
package tally

import (
	"math"
	"slices"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/job"
)

// AnomalyKinds is the number of AnomalyKind values, the unused 0 included.
const AnomalyKinds = 5

// anomalyNames by AnomalyKind number, as the API shows them.
var anomalyNames = [AnomalyKinds]string{"", "nan", "infinite", "negative", "out_of_range"}

// Counts of any number of segments.
type Counts struct {
	Mutations, PathEvaluations, Rays uint64
	LargeSteps, LargeAccepted        uint64
	SmallSteps, SmallAccepted        uint64
	SubpathSteps, SubpathAccepted    uint64
	// Second stages after rejected small and large steps.
	SecondStages, SecondAccepted               uint64
	SecondAfterLarge, SecondAfterLargeAccepted uint64
	// Coordinates that proposals asked for.
	Coordinates uint64
	Anomalies   [AnomalyKinds]uint64
	// First-stage proposals by path length in edges, and those accepted.
	ProposedByLength, AcceptedByLength [MaxLengths]uint64
	// The same by technique: vertices of the light subpath (mmlt).
	ProposedByTechnique, AcceptedByTechnique [MaxTechniques]uint64
	// LongestStay of a chain, in mutations; how many stays reached the bound that makes a chain
	// trapped, and how many of these ended.
	LongestStay, ChainsTrapped, ChainsFreed uint64
}

const (
	// MaxLengths is the number of path lengths that counts tell apart, the unused 0 included.
	MaxLengths = 33
	// MaxTechniques likewise.
	MaxTechniques = 33
	// TrappedAfter so many mutations without a move a chain counts as trapped: workers have it so.
	TrappedAfter = 2000
)

// FromProto converts a segment's counts. Anomaly kinds, path lengths and techniques that this
// version does not know are refused by the caller's validation before.
func FromProto(p *farmv1.SegmentCounts) Counts {
	c := Counts{
		Mutations: p.GetMutations(), PathEvaluations: p.GetPathEvaluations(), Rays: p.GetRays(),
		LargeSteps: p.GetLargeSteps(), LargeAccepted: p.GetLargeAccepted(),
		SmallSteps: p.GetSmallSteps(), SmallAccepted: p.GetSmallAccepted(),
		SubpathSteps: p.GetSubpathSteps(), SubpathAccepted: p.GetSubpathAccepted(),
		SecondStages: p.GetSecondStages(), SecondAccepted: p.GetSecondAccepted(),
		SecondAfterLarge: p.GetSecondAfterLarge(), SecondAfterLargeAccepted: p.GetSecondAfterLargeAccepted(),
		Coordinates: p.GetCoordinates(),
		LongestStay: p.GetLongestStay(), ChainsTrapped: p.GetChainsTrapped(), ChainsFreed: p.GetChainsFreed(),
	}
	copy(c.Anomalies[:], p.GetAnomalies())
	copy(c.ProposedByLength[:], p.GetProposedByLength())
	copy(c.AcceptedByLength[:], p.GetAcceptedByLength())
	copy(c.ProposedByTechnique[:], p.GetProposedByTechnique())
	copy(c.AcceptedByTechnique[:], p.GetAcceptedByTechnique())
	return c
}

// Add adds d to c; of the longest stays it keeps the longer.
func (c *Counts) Add(d Counts) {
	c.Mutations += d.Mutations
	c.PathEvaluations += d.PathEvaluations
	c.Rays += d.Rays
	c.LargeSteps += d.LargeSteps
	c.LargeAccepted += d.LargeAccepted
	c.SmallSteps += d.SmallSteps
	c.SmallAccepted += d.SmallAccepted
	c.SubpathSteps += d.SubpathSteps
	c.SubpathAccepted += d.SubpathAccepted
	c.SecondStages += d.SecondStages
	c.SecondAccepted += d.SecondAccepted
	c.SecondAfterLarge += d.SecondAfterLarge
	c.SecondAfterLargeAccepted += d.SecondAfterLargeAccepted
	c.Coordinates += d.Coordinates
	for i, n := range d.Anomalies {
		c.Anomalies[i] += n
	}
	for i := range MaxLengths {
		c.ProposedByLength[i] += d.ProposedByLength[i]
		c.AcceptedByLength[i] += d.AcceptedByLength[i]
	}
	for i := range MaxTechniques {
		c.ProposedByTechnique[i] += d.ProposedByTechnique[i]
		c.AcceptedByTechnique[i] += d.AcceptedByTechnique[i]
	}
	c.LongestStay = max(c.LongestStay, d.LongestStay)
	c.ChainsTrapped += d.ChainsTrapped
	c.ChainsFreed += d.ChainsFreed
}

// TrappedNow is the number of chains that are trapped at the end of what was counted.
func (c *Counts) TrappedNow() uint64 {
	if c.ChainsFreed > c.ChainsTrapped {
		return 0 // no sound counts have it so
	}
	return c.ChainsTrapped - c.ChainsFreed
}

// Words lists the counts in canonical order, for hashing.
func (c *Counts) Words() []uint64 {
	words := []uint64{
		c.Mutations, c.PathEvaluations, c.Rays,
		c.LargeSteps, c.LargeAccepted, c.SmallSteps, c.SmallAccepted, c.SubpathSteps, c.SubpathAccepted,
		c.SecondStages, c.SecondAccepted, c.SecondAfterLarge, c.SecondAfterLargeAccepted, c.Coordinates,
	}
	words = append(words, c.Anomalies[:]...)
	words = append(words, c.ProposedByLength[:]...)
	words = append(words, c.AcceptedByLength[:]...)
	words = append(words, c.ProposedByTechnique[:]...)
	words = append(words, c.AcceptedByTechnique[:]...)
	return append(words, c.LongestStay, c.ChainsTrapped, c.ChainsFreed)
}

// Acceptance returns the share of proposals that were accepted, by kind.
func (c *Counts) Acceptance() job.Acceptance {
	return job.Acceptance{
		Large: Share(c.LargeAccepted, c.LargeSteps), Small: Share(c.SmallAccepted, c.SmallSteps),
		Subpath:          Share(c.SubpathAccepted, c.SubpathSteps),
		Second:           Share(c.SecondAccepted, c.SecondStages),
		SecondAfterLarge: Share(c.SecondAfterLargeAccepted, c.SecondAfterLarge),
	}
}

// CoordinatesPerMutation of chains, 0 where none were counted.
func (c *Counts) CoordinatesPerMutation() float64 {
	if c.Mutations == 0 {
		return 0
	}
	return float64(c.Coordinates) / float64(c.Mutations)
}

// Share is nil of nothing.
func Share(part, whole uint64) *float64 {
	if whole == 0 {
		return nil
	}
	q := float64(part) / float64(whole)
	return &q
}

// AnomalyMap lists the anomalies that occurred, by name.
func (c *Counts) AnomalyMap() map[string]uint64 {
	m := make(map[string]uint64)
	for kind, n := range c.Anomalies {
		if n > 0 {
			m[anomalyNames[kind]] += n
		}
	}
	return m
}

// AnomalyNames lists the kinds of anomalies, as the API shows them.
func AnomalyNames() []string { return slices.Clone(anomalyNames[1:]) }

// Sums of independent samples of f.
type Sums struct {
	Count      uint64
	Sum        float64
	SumSquares float64
}

// Add adds one sample.
func (s *Sums) Add(f float64) {
	s.Count++
	s.Sum += f
	s.SumSquares += f * f
}

// Merge adds t, whose samples are in units of unit.
func (s *Sums) Merge(t Sums, unit float64) {
	s.Count += t.Count
	s.Sum += unit * t.Sum
	s.SumSquares += unit * unit * t.SumSquares
}

// Mean of the samples; 0 if there are none.
func (s Sums) Mean() float64 {
	if s.Count == 0 {
		return 0
	}
	return s.Sum / float64(s.Count)
}

// StandardError of the mean; 0 if there are fewer than two samples.
func (s Sums) StandardError() float64 {
	if s.Count < 2 {
		return 0
	}
	n := float64(s.Count)
	mean := s.Sum / n
	variance := math.Max(0, s.SumSquares/n-mean*mean) * n / (n - 1)
	return math.Sqrt(variance / n)
}
