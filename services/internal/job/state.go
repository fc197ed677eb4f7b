package job

import (
	"fmt"
	"slices"
)

// transitions of the state machine. A repeated path job has its film unit already and goes from
// Inspecting to Rendering; a scene without light is Done after Bootstrapping, a job that only
// inspects after Inspecting. A restarted
// coordinator puts a job that has no checkpoint back to Queued, which is no transition of its life. A
// job that is refined goes on from its last checkpoint. A job whose film does not fit beside those of
// others is Queued again once its scene was inspected, and goes on where it was.
var transitions = map[State][]State{
	Queued:        {Inspecting, Bootstrapping, Rendering, Failed, Canceled},
	Inspecting:    {Queued, Bootstrapping, Rendering, Done, Failed, Canceled},
	Bootstrapping: {Queued, Rendering, Done, Failed, Canceled},
	Rendering:     {Done, Failed, Canceled},
	Done:          {Rendering},
	Canceled:      {Rendering},
}

// Ended tells whether nothing more happens to the job by itself.
func (s State) Ended() bool { return s == Done || s == Failed || s == Canceled }

// To checks a transition; it fails with ErrConflict if the state machine has no such edge.
func (s State) To(next State) error {
	if slices.Contains(transitions[s], next) {
		return nil
	}
	return fmt.Errorf("job is %s, it cannot become %s: %w", s, next, ErrConflict)
}
