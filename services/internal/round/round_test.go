package round

import (
	"testing"

	"metrofarm/services/internal/job"
)

func entries(digest uint64, segments ...int) []Entry {
	var batch []Entry
	for _, s := range segments {
		batch = append(batch, Entry{Segment: s, Mark: Mark{Digest: digest + uint64(s)}})
	}
	return batch
}

func TestJudge(t *testing.T) {
	l := NewLedger([]bool{true, true, true, false})
	l.Count(entries(10, 0, 1))
	for name, c := range map[string]struct {
		batch []Entry
		want  Verdict
		fails bool
	}{
		"new":              {entries(10, 2), Fresh, false},
		"repeated":         {entries(10, 1, 0), Duplicate, false},
		"partly repeated":  {entries(10, 1, 2), Superseded, false},
		"other digest":     {entries(11, 1), Conflict, false},
		"partly, other":    {entries(11, 1, 2), Conflict, false},
		"dark segment":     {entries(10, 3), 0, true},
		"beyond":           {entries(10, 4), 0, true},
		"listed twice":     {entries(10, 2, 2), 0, true},
		"without segments": {nil, 0, true},
	} {
		got, err := l.Judge(c.batch)
		if (err != nil) != c.fails || got != c.want {
			t.Errorf("%s: %v, error %v", name, got, err)
		}
	}
	if l.Complete() {
		t.Error("complete without segment 2")
	}
	clone := l.Clone()
	l.Count(entries(10, 2))
	if !l.Complete() || clone.Complete() {
		t.Error("a clone follows its ledger, or the ledger is not complete")
	}
}

func TestEvidenceIsPartOfTheMark(t *testing.T) {
	l := NewLedger([]bool{true})
	l.Count(entries(1, 0))
	other := entries(1, 0)
	other[0].Mark.Evidence[3] = 1
	if got, _ := l.Judge(other); got != Conflict {
		t.Errorf("another chain state with the same film is %v", got)
	}
}

func TestDecide(t *testing.T) {
	sizes := []uint64{4, 6, 9, 13}
	for name, c := range map[string]struct {
		rules    job.StopRules
		errors   []float64
		recorded *Decision
		want     string
	}{
		"going on":              {job.StopRules{}, []float64{1, 1}, nil, ""},
		"end of the list":       {job.StopRules{}, []float64{1, 1, 1, 1}, nil, StopCount},
		"count":                 {job.StopRules{SamplesPerPixel: 10}, []float64{1, 1}, nil, StopCount},
		"count not reached":     {job.StopRules{SamplesPerPixel: 11}, []float64{1, 1}, nil, ""},
		"rounds":                {job.StopRules{Rounds: 2}, []float64{1, 1}, nil, StopRounds},
		"one round under":       {job.StopRules{TargetError: 0.5}, []float64{1, 0.1}, nil, ""},
		"first round under":     {job.StopRules{TargetError: 0.5}, []float64{0.1}, nil, ""},
		"two rounds under":      {job.StopRules{TargetError: 0.5}, []float64{1, 0.4, 0.4}, nil, StopError},
		"not consecutive":       {job.StopRules{TargetError: 0.5}, []float64{0.4, 1, 0.4}, nil, ""},
		"unknown is not under":  {job.StopRules{TargetError: 0.5}, []float64{-1, -1}, nil, ""},
		"recorded for later":    {job.StopRules{}, []float64{1}, &Decision{1, StopTime}, ""},
		"recorded for this one": {job.StopRules{}, []float64{1, 1}, &Decision{1, StopTime}, StopTime},
	} {
		got, last := Decide(c.rules, sizes, 1, c.errors, c.recorded)
		if last != (c.want != "") || got.Reason != c.want || last && got.Round != len(c.errors)-1 {
			t.Errorf("%s: %+v, last %v", name, got, last)
		}
	}
}
