package coordinator

import (
	"fmt"
	"math"
	"slices"

	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/render"
	"metrofarm/services/internal/round"
	"metrofarm/services/internal/tally"
)

// almostDone is the most that the progress of an unfinished job shows.
const almostDone = 0.999

// snapshot is the job's public view. Requires: mu.
func (r *run) snapshot() job.Snapshot {
	if r.rec.State.Ended() && r.rec.Summary != nil {
		return *r.rec.Summary
	}
	s := job.Snapshot{
		ID: r.id, User: r.rec.User, Sequence: r.rec.FrameOf, Request: r.rec.Request, State: r.rec.State, Paused: r.rec.Paused,
		PauseReason: r.rec.PauseReason, Error: r.rec.Error,
		CreatedAt: r.rec.CreatedAt, StartedAt: r.rec.StartedAt, EndedAt: r.rec.EndedAt,
		StopReason: r.rec.StopReason, Refinements: r.rec.Refinements, Seed: r.rec.Request.Seed, Activity: r.activity,
		WallSeconds: r.wallSeconds(), LoadSeconds: r.extra.LoadSeconds,
		Anomalies: map[string]uint64{}, Warnings: slices.Concat(r.report.GetWarnings(), r.rec.Warnings),
	}
	s.Stale, s.WaitingForMemory = r.gone.Load(), r.waitingForRoom()
	r.describeSpec(&s)
	r.describeWork(&s)
	r.describePhase(&s)
	s.Progress = r.progress(&s)
	if s.Progress > 0 && s.Progress < 1 && s.WallSeconds > 0 {
		s.ETASeconds = s.WallSeconds * (1 - s.Progress) / s.Progress
	}
	return s
}

func (r *run) describeSpec(s *job.Snapshot) {
	if r.spec == nil {
		return
	}
	s.Width, s.Height = int(r.spec.GetWidth()), int(r.spec.GetHeight())
	if r.piloting() {
		return
	}
	s.Integrator, s.Seed = plan.IntegratorName(r.spec), r.spec.GetSeed()
	if r.spec.GetUnit() == 0 {
		return
	}
	if text, err := plan.FormatResolved(r.spec); err == nil {
		s.Resolved = text
	}
}

// describeWork fills in counts: those of complete rounds and of what is merged beyond them.
func (r *run) describeWork(s *job.Snapshot) {
	s.PathEvaluations = r.extra.BootstrapEvaluations
	s.Rays = r.extra.BootstrapRays
	s.CPUSeconds = r.extra.BootstrapCPUSeconds
	counts := tally.Counts{Anomalies: r.extra.BootstrapAnomalies}
	if r.state != nil {
		counts.Add(r.state.Account.Counts)
		s.CPUSeconds += r.state.Account.CPUSeconds
		for _, o := range r.state.Open {
			counts.Add(o.Account.Counts)
			s.CPUSeconds += o.Account.CPUSeconds
		}
		r.describePoints(s)
	}
	s.Mutations = counts.Mutations
	s.PathEvaluations += counts.PathEvaluations
	s.Rays += counts.Rays
	s.Anomalies = counts.AnomalyMap()
	s.Acceptance, s.CoordinatesPerMutation = counts.Acceptance(), counts.CoordinatesPerMutation()
	s.LongestStay, s.TrappedChains = counts.LongestStay, counts.TrappedNow()
	if r.state != nil {
		s.Lengths, s.Techniques = lengths(r.state, &counts), techniques(&counts)
	}
	if r.rec.State == job.Rendering {
		s.MutationsPerSecond = r.meter.rate(r.c.options.Now())
	}
}

func (r *run) describePoints(s *job.Snapshot) {
	points := r.state.History()
	s.RoundsDone = len(points)
	if s.RoundsDone == 0 {
		s.FilmSHA256 = r.emptySHA
		s.B, s.BStandardError = bootstrapB(r.state.Bootstrap)
		return
	}
	p := points[s.RoundsDone-1]
	s.B, s.BStandardError, s.FilmSHA256 = p.B, p.BStandardError, p.FilmSHA256
	s.EffectiveSamples, s.EffectiveSamplesPerMutation = p.EffectiveSamples, p.EffectiveSamplesPerMutation
	if known(p) {
		s.RelMSE, s.RelMSEInterval = &p.RelMSE, &p.RelMSEInterval
	}
}

// known tells whether the point has an error estimate: a point without has no interval either.
func known(p job.ConvergencePoint) bool {
	return p.RelMSEInterval.High > 0 || p.RelMSEInterval.Level > 0
}

func bootstrapB(halves [film.Halves]tally.Sums) (b, standardError float64) {
	var all tally.Sums
	for _, h := range halves {
		all.Merge(h, 1)
	}
	return all.Mean(), all.StandardError()
}

// lengths tells of the samples of each length up to the longest that there was, none where nothing
// was counted by length.
func lengths(state *render.State, counts *tally.Counts) []job.Length {
	proposed, used := total(counts.ProposedByLength[:])
	var all []job.Length
	for edges := 1; edges < max(used, len(state.Lengths)+1); edges++ {
		length := job.Length{
			Edges:      edges,
			Proposed:   tally.Share(counts.ProposedByLength[edges], proposed),
			Acceptance: tally.Share(counts.AcceptedByLength[edges], counts.ProposedByLength[edges]),
		}
		if k := edges - 1; k < len(state.Lengths) {
			b, standardError := state.Lengths[k].Mean(), state.Lengths[k].StandardError()
			length.B, length.BStandardError = &b, &standardError
			if p := state.Spec.GetLengthProbabilities(); k < len(p) {
				length.Probability = &p[k]
			}
		}
		all = append(all, length)
	}
	return all
}

// techniques tells of the samples of each technique up to the last that there was.
func techniques(counts *tally.Counts) []job.Technique {
	proposed, used := total(counts.ProposedByTechnique[:])
	var all []job.Technique
	for s := range used {
		all = append(all, job.Technique{
			LightVertices: s,
			Proposed:      tally.Share(counts.ProposedByTechnique[s], proposed),
			Acceptance:    tally.Share(counts.AcceptedByTechnique[s], counts.ProposedByTechnique[s]),
		})
	}
	return all
}

// total sums counts, and tells how many there are up to the last that is not zero.
func total(counts []uint64) (sum uint64, used int) {
	for i, n := range counts {
		sum += n
		if n > 0 {
			used = i + 1
		}
	}
	return sum, used
}

func (r *run) describePhase(s *job.Snapshot) {
	switch {
	case r.rec.State == job.Bootstrapping && r.spec != nil:
		s.RoundSegments = len(plan.BootstrapRanges(r.spec))
		s.RoundSegmentsDone = s.RoundSegments - r.table.Open()
	case r.rec.State == job.Rendering && r.state != nil && len(r.state.Open) > 0:
		for _, expected := range r.state.Expected() {
			if expected {
				s.RoundSegments++
			}
		}
		s.RoundSegmentsDone = s.RoundSegments - r.state.Open[0].Ledger.Missing
	}
	switch held := len(r.checks.held); {
	case s.Activity != "":
	case r.waitingForRoom():
		s.Activity = r.waitsForRoom()
	case r.waitsForVersion():
		s.Activity = fmt.Sprintf("waiting for a worker of version %s", r.spec.GetWorkerVersion())
	case held > 0:
		s.Activity = fmt.Sprintf("%d batches wait for a second worker to confirm them", held)
	}
}

func (r *run) waitsForVersion() bool {
	return !r.rec.State.Ended() && r.spec.GetWorkerVersion() != "" &&
		!r.c.hearsOf(r.spec.GetWorkerVersion())
}

// progress towards the nearest stop rule, floored to a thousandth.
func (r *run) progress(s *job.Snapshot) float64 {
	if r.rec.State == job.Done {
		return 1
	}
	if r.state == nil {
		return 0
	}
	stop := r.rec.Request.Stop
	fraction := 0.0
	if s.RoundSegments > 0 {
		fraction = float64(s.RoundSegmentsDone) / float64(s.RoundSegments)
	}
	best := r.countProgress(fraction)
	if stop.TimeSeconds > 0 {
		best = max(best, s.WallSeconds/stop.TimeSeconds)
	}
	if stop.TargetError > 0 && s.RelMSE != nil && *s.RelMSE > 0 {
		// The error falls with the inverse of the work.
		best = max(best, stop.TargetError / *s.RelMSE)
	}
	return math.Floor(min(best, almostDone)*1000) / 1000
}

// countProgress is the share of mutations or samples up to the last round that may be needed.
func (r *run) countProgress(fraction float64) float64 {
	sizes := r.spec.GetRoundSizes()[:r.lastRound()+1]
	total := round.PerPixel(sizes, 1)
	closed := min(r.state.Closed, len(sizes))
	done := round.PerPixel(sizes[:closed], 1)
	if closed < len(sizes) {
		cut := 0.0
		if r.state.Cut != nil {
			cut = float64(r.state.Cut.Size)
		}
		done += cut + fraction*(float64(sizes[closed])-cut)
	}
	return done / total
}
