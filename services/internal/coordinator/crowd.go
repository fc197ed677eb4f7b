package coordinator

import (
	"cmp"
	"fmt"

	"metrofarm/services/internal/job"
)

// Jobs that have not ended take memory here and in the store, whether anything is rendered of them or
// not. How many there are is known exactly of this coordinator's own, and of those of others as they said
// with their last beat: several that are asked at once may together exceed a limit by what they accept in
// that time. Jobs between two owners are not counted.

// unended counts the jobs that have not ended, by user. Requires: Coordinator.mu.
func (c *Coordinator) unended() map[string]int {
	users := make(map[string]int)
	for _, r := range c.order {
		if !r.standing.ended.Load() {
			users[r.user]++
		}
	}
	return users
}

// checkCrowd tells whether there is room for more jobs of a user. Requires: submitMu where they are to be
// created, or else they may be a few too many.
func (c *Coordinator) checkCrowd(user string, more int) error {
	c.mu.Lock()
	defer c.mu.Unlock()
	users := c.unended()
	for other, n := range c.crowd {
		users[other] += n
	}
	all := 0
	for _, n := range users {
		all += n
	}
	if err := crowded("all users", all, more, c.options.MaxJobs); err != nil {
		return err
	}
	return crowded(cmp.Or(user, "users without a name"), users[user], more, c.options.MaxUserJobs)
}

func crowded(whose string, there, more, most int) error {
	switch {
	case most == 0 || there+more <= most:
		return nil
	case more > most:
		return &job.FieldError{Field: "frames.end", Detail: fmt.Sprintf(
			"makes %d jobs; this server takes at most %d of %s that have not ended", more, most, whose)}
	}
	return fmt.Errorf("%w: %d of %s have not ended, and with %d more there would be over %d, the most that this server takes: "+
		"wait until some have ended, or cancel some", job.ErrTooMany, there, whose, more, most)
}
