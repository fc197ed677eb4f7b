// Package check decides about segments that are rendered twice on purpose: which ones those are, and
// who is right when renderings of one segment differ. It is pure.
package check

import (
	"slices"

	"metrofarm/services/internal/round"
)

// OneIn segments, one is rendered twice where two workers exist. A worker whose segments are wrong
// with probability p, in any way that its own digests hide, passes n of them unnoticed with
// probability (1 - p / OneIn)^n.
const OneIn = 1000

// Selected tells whether a segment is rendered twice. It depends on the job alone, so no worker or
// restart changes the choice. oneIn is the reciprocal of the rate; none are selected if it is not
// positive.
func Selected(oneIn int, seed uint64, number, segment int) bool {
	if oneIn <= 0 {
		return false
	}
	return mix(mix(mix(seed)+uint64(number))+uint64(segment))%uint64(oneIn) == 0
}

// mix is one step of SplitMix64.
func mix(x uint64) uint64 {
	x += 0x9e3779b97f4a7c15
	x = (x ^ x>>30) * 0xbf58476d1ce4e5b9
	x = (x ^ x>>27) * 0x94d049bb133111eb
	return x ^ x>>31
}

// Testimony is what a worker rendered a segment to.
type Testimony struct {
	Worker string
	Mark   round.Mark
}

// Case is one segment under check: the testimonies of different workers, oldest first.
type Case struct {
	Heard []Testimony
}

// Status of a case.
type Status int

// The statuses.
const (
	Open     Status = iota // one worker is heard: another must be
	Agreed                 // two workers rendered the same: that is right
	Disputed               // two workers differ: a third must be heard
	Hung                   // three workers or more, and no two agree
)

// Ruling is what the testimonies say.
type Ruling struct {
	Status Status
	// Mark of the right rendering and Wrong, the workers that rendered another: if Agreed.
	Mark  round.Mark
	Wrong []string
}

// Hear adds a testimony. A worker is heard once: what it says again confirms nothing.
func (c *Case) Hear(worker string, mark round.Mark) {
	if !c.Knows(worker) {
		c.Heard = append(c.Heard, Testimony{worker, mark})
	}
}

// Knows tells whether a worker was heard.
func (c *Case) Knows(worker string) bool {
	return slices.ContainsFunc(c.Heard, func(t Testimony) bool { return t.Worker == worker })
}

// Withdraw forgets what a worker said.
func (c *Case) Withdraw(worker string) {
	c.Heard = slices.DeleteFunc(c.Heard, func(t Testimony) bool { return t.Worker == worker })
}

// Ruling decides.
func (c *Case) Ruling() Ruling {
	votes := make(map[round.Mark]int)
	for _, t := range c.Heard {
		votes[t.Mark]++
		if votes[t.Mark] == 2 {
			return Ruling{Status: Agreed, Mark: t.Mark, Wrong: c.others(t.Mark)}
		}
	}
	return Ruling{Status: [...]Status{Open, Open, Disputed, Hung}[min(len(c.Heard), 3)]}
}

func (c *Case) others(mark round.Mark) []string {
	var others []string
	for _, t := range c.Heard {
		if t.Mark != mark {
			others = append(others, t.Worker)
		}
	}
	return others
}
