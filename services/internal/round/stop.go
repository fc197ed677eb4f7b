package round

import "metrofarm/services/internal/job"

// Stop reasons, as job.Snapshot shows them.
const (
	StopCount    = "count"        // the requested samples or mutations are done
	StopRounds   = "rounds"       // the requested number of rounds is done
	StopError    = "target_error" // two consecutive rounds were under the target
	StopTime     = "time"         // the time limit passed; the round under way was the last
	StopFinished = "finished"     // the user asked for it; the round under way was the last
	StopBlack    = "black"        // nothing in the scene carries light
)

// Decision says that a round is the last one, and why. It is recorded before it takes effect.
type Decision struct {
	Round  int    `json:"round"`
	Reason string `json:"reason"`
}

// Decide is called after each complete round with all relative errors so far (negative: unknown).
// sizes are the rounds of the spec, perPixel is how many requested units per pixel one unit of size
// amounts to, recorded an earlier decision (nil: none).
func Decide(rules job.StopRules, sizes []uint64, perPixel float64, relMSE []float64, recorded *Decision) (Decision, bool) {
	done := len(relMSE)
	last := done - 1
	if recorded != nil && last >= recorded.Round {
		return Decision{last, recorded.Reason}, true
	}
	if rules.Rounds > 0 && done >= rules.Rounds {
		return Decision{last, StopRounds}, true
	}
	if done >= len(sizes) || countReached(rules, sizes[:done], perPixel) {
		return Decision{last, StopCount}, true
	}
	if rules.TargetError > 0 && done >= 2 && under(relMSE[last], rules.TargetError) && under(relMSE[last-1], rules.TargetError) {
		return Decision{last, StopError}, true
	}
	return Decision{}, false
}

func under(relMSE, target float64) bool { return relMSE >= 0 && relMSE < target }

// countReached matters for a repeated job, whose list of rounds is not cut to its own count.
func countReached(rules job.StopRules, sizes []uint64, perPixel float64) bool {
	target := max(rules.SamplesPerPixel, rules.MutationsPerPixel)
	return target > 0 && PerPixel(sizes, perPixel) >= float64(target)
}

// PerPixel is what rounds of these sizes amount to per pixel.
func PerPixel(sizes []uint64, perPixel float64) float64 {
	var sum uint64
	for _, n := range sizes {
		sum += n
	}
	return float64(sum) * perPixel
}
