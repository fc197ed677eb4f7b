package coordinator

import "context"

// OccupyDevelopers takes all places for developments until done is called.
func (c *Coordinator) OccupyDevelopers() (done func()) {
	_ = c.imaging.slots.Acquire(context.Background(), maxDevelopers) // that many there are
	return func() { c.imaging.slots.Release(maxDevelopers) }
}
