package check

import (
	"math"
	"slices"
	"testing"

	"metrofarm/services/internal/round"
)

// TestSelectedRate counts n = 10^6 segments per job. Under the null hypothesis of independent
// choices with probability 1/1000 the count has standard deviation 31.6; five of them are exceeded
// by chance in fewer than 1 of 10^6 runs, and the seeds are fixed.
func TestSelectedRate(t *testing.T) {
	const rounds, segments = 100, 10000
	for seed := range uint64(8) {
		n := 0
		for number := range rounds {
			for segment := range segments {
				if Selected(OneIn, seed, number, segment) {
					n++
				}
			}
		}
		expected := float64(rounds*segments) / OneIn
		if math.Abs(float64(n)-expected) > 5*math.Sqrt(expected) {
			t.Errorf("seed %d: %d of %d segments selected", seed, n, rounds*segments)
		}
	}
}

func TestSelectedDependsOnSeedAndRound(t *testing.T) {
	list := func(seed uint64, number int) (selected []int) {
		for segment := range 20 * OneIn {
			if Selected(OneIn, seed, number, segment) {
				selected = append(selected, segment)
			}
		}
		return selected
	}
	if slices.Equal(list(1, 0), list(2, 0)) || slices.Equal(list(1, 0), list(1, 1)) {
		t.Error("the same segments are selected")
	}
	if !Selected(1, 7, 3, 2) || Selected(0, 7, 3, 2) || Selected(-1, 7, 3, 2) {
		t.Error("all or none are not selected")
	}
}

func TestRuling(t *testing.T) {
	x, y, z := round.Mark{Digest: 1}, round.Mark{Digest: 2}, round.Mark{Digest: 1, Evidence: [16]byte{1}}
	for name, test := range map[string]struct {
		marks  []round.Mark
		status Status
		wrong  []string
	}{
		"one":             {[]round.Mark{x}, Open, nil},
		"two agree":       {[]round.Mark{x, x}, Agreed, nil},
		"two differ":      {[]round.Mark{x, y}, Disputed, nil},
		"states differ":   {[]round.Mark{x, z}, Disputed, nil},
		"first is wrong":  {[]round.Mark{x, y, y}, Agreed, []string{"a"}},
		"second is wrong": {[]round.Mark{x, y, x}, Agreed, []string{"b"}},
		"three differ":    {[]round.Mark{x, y, z}, Hung, nil},
	} {
		c := &Case{}
		for i, mark := range test.marks {
			c.Hear(string(rune('a'+i)), mark)
		}
		ruling := c.Ruling()
		if ruling.Status != test.status || !slices.Equal(ruling.Wrong, test.wrong) {
			t.Errorf("%s: %+v", name, ruling)
		}
		if ruling.Status == Agreed && ruling.Mark != test.marks[len(test.marks)-1] {
			t.Errorf("%s: %+v is right", name, ruling.Mark)
		}
	}
}

func TestAWorkerIsHeardOnce(t *testing.T) {
	c := &Case{}
	c.Hear("a", round.Mark{Digest: 1})
	c.Hear("a", round.Mark{Digest: 1})
	if got := c.Ruling().Status; got != Open {
		t.Errorf("a worker confirmed itself: %v", got)
	}
	c.Hear("b", round.Mark{Digest: 2})
	c.Withdraw("b")
	if got := c.Ruling().Status; got != Open || c.Knows("b") || !c.Knows("a") {
		t.Errorf("after b's testimony was withdrawn: %v, %+v", got, c.Heard)
	}
}
