package render

import (
	"crypto/sha256"
	"encoding/binary"
	"encoding/hex"
	"fmt"
	"io"
	"math"
	"slices"

	"metrofarm/services/internal/convergence"
	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/diagnose"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/tally"
)

// Snapshot returns the progress so far for reading while the state goes on.
func (s *State) Snapshot() *State {
	c := &State{Spec: s.Spec, Cells: s.Cells, Progress: s.Progress, expected: s.expected}
	c.Total = s.Total.Snapshot()
	c.States, c.Sums = slices.Clone(s.States), slices.Clone(s.Sums)
	c.Points = slices.Clone(s.Points)
	c.Open = make([]*Open, len(s.Open))
	for i, o := range s.Open {
		record := o.OpenRecord
		record.Ledger = o.Ledger.Clone()
		record.States, record.Sums = slices.Clone(o.States), slices.Clone(o.Sums)
		c.Open[i] = &Open{OpenRecord: record, Film: o.Film.Snapshot()}
	}
	return c
}

// Fold adds the first open round to the closed ones. Requires: Complete. It is called on a
// snapshot, off every lock, because it touches the whole film; Adopt then takes the result over.
func (s *State) Fold() error {
	o := s.Open[0]
	if err := s.Total.AddFilm(o.Film); err != nil {
		return fmt.Errorf("render: fold round %d: %w", o.Round, err)
	}
	s.Account.add(o.Account)
	for g, e := range s.expected {
		if e {
			s.States[g], s.Sums[g] = o.States[g], o.Sums[g]
		}
	}
	s.Previous = o.Ledger
	s.Open = s.Open[1:]
	s.closeCut()
	s.Closed++
	return nil
}

// Adopt takes over the closed rounds of a folded snapshot. What was delivered to the next round
// since the snapshot stays.
func (s *State) Adopt(folded *State) {
	s.Progress, s.Total = folded.Progress, folded.Total
	s.Open = s.Open[1:]
	s.OpenRound(s.Closed)
}

// Drop forgets the open rounds: the last round is closed.
func (s *State) Drop() { s.Open = nil }

// Scales of the closed rounds.
func (s *State) Scales() develop.Scales {
	if !s.Chains() {
		return develop.Path(s.Spec.GetUnit(), s.SamplesBefore(s.Closed))
	}
	return develop.PSSMLT(s.chainTotals())
}

// Layers develops those of the film that the spec asks for beside the image.
func (s *State) Layers() []job.ImageLayer {
	var all []job.ImageLayer
	if layer, has := plan.AcceptanceLayer(s.Spec); has {
		all = append(all, develop.AcceptanceMap(s.Total, layer, s.Cells, s.Account.Counts.Mutations))
	}
	if first, has := plan.TechniqueLayers(s.Spec); has {
		all = append(all, develop.Techniques(s.Total, s.Scales(), first, plan.TechniqueImages)...)
	}
	return all
}

func (s *State) chainTotals() develop.ChainTotals {
	t := develop.ChainTotals{
		Cells: s.Cells, Unit: s.Spec.GetUnit(),
		Mutations: s.Account.Mutations, LargeSteps: s.Account.LargeSteps, Samples: s.Bootstrap,
	}
	if plan.DirectApart(s.Spec) {
		t.Direct, t.DirectUnit = s.DirectBefore(s.Closed), plan.DirectUnit*t.Unit
	}
	for g, chains := range s.Sums {
		for _, c := range chains {
			t.Samples[g%film.Halves].Merge(c, t.Unit)
		}
	}
	return t
}

// Evaluate describes the closed rounds: error, b and the film's hash. Clock and wall time are the
// caller's to add.
func (s *State) Evaluate() (job.ConvergencePoint, error) {
	scales := s.Scales()
	images := develop.Develop(s.Total, scales)
	estimate := convergence.Of(images, develop.LowGroups(s.Total, scales), scales)
	sha, err := s.FilmSHA256()
	if err != nil {
		return job.ConvergencePoint{}, err
	}
	b, standardError := scales.B.Mean(), scales.B.StandardError()
	if !s.Chains() {
		b, standardError = pathB(&images)
	}
	point := job.ConvergencePoint{
		Round:           s.Closed - 1,
		Mutations:       s.Account.Counts.Mutations,
		PathEvaluations: s.Account.Counts.PathEvaluations,
		Rays:            s.Account.Counts.Rays,
		RelMSE:          estimate.RelMSE,
		RelMSEInterval:  estimate.Interval,
		B:               b,
		BStandardError:  standardError,
		CPUSeconds:      s.Account.CPUSeconds,
		FilmSHA256:      sha,

		Acceptance:             s.Account.Counts.Acceptance(),
		CoordinatesPerMutation: s.Account.Counts.CoordinatesPerMutation(),
	}
	if s.Chains() {
		effective := diagnose.EffectiveSamples(s.Total, s.chainTotals(), plan.TargetDensity(s.Spec))
		point.EffectiveSamples = effective.Samples
		point.EffectiveSamplesPerMutation = effective.PerMutation
	}
	return point, checkFinite(&point)
}

// checkFinite names an estimate that is infinite or no number: the unit of the film, or what workers
// report of the light, is beyond what images can have.
func checkFinite(p *job.ConvergencePoint) error {
	for _, c := range []struct {
		name  string
		value float64
	}{
		{"rel_mse", p.RelMSE},
		{"rel_mse_interval.low", p.RelMSEInterval.Low},
		{"rel_mse_interval.high", p.RelMSEInterval.High},
		{"b", p.B},
		{"b_standard_error", p.BStandardError},
		{"effective_samples", p.EffectiveSamples},
		{"effective_samples_per_mutation", p.EffectiveSamplesPerMutation},
	} {
		if math.IsNaN(c.value) || math.IsInf(c.value, 0) {
			return fmt.Errorf("render: %s is %v after round %d: the light is too bright or too dark for the numbers of an image; "+
				"scale the scene's lights", c.name, c.value, p.Round)
		}
	}
	return nil
}

// pathB is the mean luminance of a path-traced image; the halves' difference is its error.
func pathB(m *develop.Images) (b, standardError float64) {
	b0, b1 := develop.MeanLuminance(m.Halves[0]), develop.MeanLuminance(m.Halves[1])
	w0, w1 := m.Weights[0], m.Weights[1]
	return w0*b0 + w1*b1, math.Abs(b0-b1) * math.Sqrt(w0*w1)
}

// FilmSHA256 hashes the closed rounds canonically; film/DESIGN.md has the layout.
func (s *State) FilmSHA256() (string, error) {
	h := sha256.New()
	if err := s.writeCanonical(h); err != nil {
		return "", fmt.Errorf("render: hash: %w", err)
	}
	return hex.EncodeToString(h.Sum(nil)), nil
}

func (s *State) writeCanonical(w io.Writer) error {
	words := []uint64{
		uint64(s.Spec.GetIntegrator()), uint64(s.Cells), math.Float64bits(s.Spec.GetUnit()),
		s.Spec.GetSeed(), uint64(s.Closed),
	}
	words = append(words, s.Account.Counts.Words()...)
	if s.Chains() {
		for _, half := range s.Bootstrap {
			words = appendSums(words, half)
		}
		for _, chains := range s.Sums {
			for _, c := range chains {
				words = appendSums(words, c)
			}
		}
	}
	buffer := []byte("metrofarm film 3\n")
	for _, word := range words {
		buffer = binary.LittleEndian.AppendUint64(buffer, word)
	}
	if _, err := w.Write(buffer); err != nil {
		return err
	}
	return s.Total.Write(w)
}

func appendSums(words []uint64, s tally.Sums) []uint64 {
	return append(words, s.Count, math.Float64bits(s.Sum), math.Float64bits(s.SumSquares))
}
