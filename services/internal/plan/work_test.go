package plan

import (
	"fmt"
	"math"
	"strings"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

// recorded is a spec as a job of the request leaves it.
func recorded(t *testing.T, r job.Request, width, height uint32) *jobv1.ResolvedSpec {
	t.Helper()
	spec := resolve(t, r, scene(width, height, ""))
	SetUnit(spec, 1)
	if Multiplexed(spec) {
		spec.LengthProbabilities = make([]float64, spec.GetMaxDepth())
		spec.LengthProbabilities[0] = 1
	}
	return spec
}

// TestWhatIsPlannedCanBeRepeated: the limits on specs from outside leave room for every spec of our own.
func TestWhatIsPlannedCanBeRepeated(t *testing.T) {
	stops := []job.StopRules{
		{TimeSeconds: 1},
		{Rounds: 1},
		{SamplesPerPixel: 1},
		{MutationsPerPixel: 1},
		{SamplesPerPixel: 1 << 20},
		{MutationsPerPixel: 1 << 20},
		{SamplesPerPixel: 1000},
		{MutationsPerPixel: 1000},
	}
	for _, size := range [][2]uint32{{1, 1}, {70, 41}, {4096, 1}, {32768, 1}, {1, 32768}, {1920, 1080}, {32768, 2048}, {8192, 8192}} {
		for _, integrator := range []string{job.IntegratorPath, job.IntegratorBDPT, job.IntegratorPSSMLT, job.IntegratorMMLT} {
			for _, stop := range stops {
				for _, chains := range []uint64{0, 1, 1 << 17} {
					r := job.Request{Integrator: integrator, Chains: chains, DirectApart: job.On, Stop: stop}
					if detail := checkSpec(recorded(t, r, size[0], size[1])); detail != "" {
						t.Errorf("%v %s, %d chains, %+v: %s", size, integrator, chains, stop, detail)
					}
				}
			}
		}
	}
}

func TestWorkThatNoJobMakesIsRefused(t *testing.T) {
	path := job.Request{Integrator: job.IntegratorPath, Stop: job.StopRules{TimeSeconds: 1}}
	chains := job.Request{Integrator: job.IntegratorPSSMLT, DirectApart: job.On, Stop: job.StopRules{TimeSeconds: 1}}
	cases := []struct {
		name    string
		request job.Request
		change  func(*jobv1.ResolvedSpec)
		says    string // empty: taken
	}{
		{"a unit that is 0 as float32", chains, func(s *jobv1.ResolvedSpec) { s.Unit = 1e200 }, "unit is 1e+200, outside 1e-38..1e+45"},
		{"a unit whose reciprocal is infinite", path, func(s *jobv1.ResolvedSpec) { s.Unit = 1e-200 }, "unit is 1e-200"},
		{"no number", path, func(s *jobv1.ResolvedSpec) { s.Unit = math.NaN() }, "unit is NaN"},
		{"an infinite unit", path, func(s *jobv1.ResolvedSpec) { s.Unit = math.Inf(1) }, "unit is +Inf"},
		{"a bright scene", chains, func(s *jobv1.ResolvedSpec) { s.Unit = 7.4e40 }, ""},
		{"a task for each cell", path, func(s *jobv1.ResolvedSpec) { s.GroupSize, s.BlocksPerSegment = 1, 1 }, "group_size is 1; workers have groups of 64"},
		{"many tasks", path, func(s *jobv1.ResolvedSpec) { s.BlocksPerSegment = 1 }, "blocks_per_segment is 1, which makes up to 34300 segments"},
		{"fewer", path, func(s *jobv1.ResolvedSpec) { s.BlocksPerSegment = 3 }, ""},
		{"a long first round", path, func(s *jobv1.ResolvedSpec) { s.RoundSizes = []uint64{1 << 30} }, "a segment of the first round has at most 1073741824"},
		{"one for chains", chains, func(s *jobv1.ResolvedSpec) { s.RoundSizes, s.DirectSizes = []uint64{1<<24 + 1}, nil }, "round_sizes begin with 16777217"},
		{"as long as may be", chains, func(s *jobv1.ResolvedSpec) { s.RoundSizes, s.DirectSizes = []uint64{1 << 24}, nil }, ""},
		{"a long second round", path, func(s *jobv1.ResolvedSpec) { s.RoundSizes = []uint64{4, 9} }, "round_sizes has 9 for round 1"},
		{"one twice as long", path, func(s *jobv1.ResolvedSpec) { s.RoundSizes = []uint64{4, 8, 24, 1} }, ""},
		{"much direct light", chains, func(s *jobv1.ResolvedSpec) { s.DirectSizes[3] = 1 << 48 }, "direct_sizes ask for"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			spec := recorded(t, c.request, 1920, 1080)
			c.change(spec)
			detail := checkSpec(spec)
			if (detail == "") != (c.says == "") || !strings.Contains(detail, c.says) {
				t.Errorf("%q, want %q", detail, c.says)
			}
		})
	}
}

func TestRoundsAreLimitedAsCountsAre(t *testing.T) {
	limits := Limits{PerPixel: 100}
	for _, c := range []struct {
		stop  job.StopRules
		field string
	}{
		{job.StopRules{Rounds: 3}, ""},
		{job.StopRules{Rounds: 20}, "stop.rounds"},
		{job.StopRules{Rounds: 20, SamplesPerPixel: 50}, ""},
		{job.StopRules{Rounds: 20, TimeSeconds: 1}, ""},
	} {
		r := job.Request{Integrator: job.IntegratorPath, Stop: c.stop}
		err := limits.Check(recorded(t, r, 64, 48), r, scene(64, 48, ""))
		detail := ""
		if c.field != "" {
			detail = "this server takes at most 100"
		}
		expectField(t, err, c.field, detail)
	}
}

func TestLongSpecsAreRefused(t *testing.T) {
	text := fmt.Sprintf("{%*s}", maxSpecBytes, "")
	_, err := ParseResolved(text)
	expectField(t, err, "resolved", "has 262146 bytes; a spec has at most 262144")
}

func TestRepeatedRoundsAreLimitedAsOthers(t *testing.T) {
	const path, chains = job.IntegratorPath, job.IntegratorPSSMLT
	limits := Limits{PerPixel: 100}
	cases := []struct {
		name           string
		integrator     string
		recorded, stop job.StopRules
		detail         string // empty: taken
	}{
		{"as many as may be", path, job.StopRules{SamplesPerPixel: 100}, job.StopRules{}, ""},
		{"one more", path, job.StopRules{SamplesPerPixel: 101}, job.StopRules{}, "asks for rounds of 101.0 mutations or samples per pixel; this server takes at most 100"},
		{"as many, by chains", chains, job.StopRules{MutationsPerPixel: 100}, job.StopRules{}, ""},
		{"more, by chains", chains, job.StopRules{MutationsPerPixel: 150}, job.StopRules{}, "at most 100"},
		{"stopped by rounds", path, job.StopRules{SamplesPerPixel: 1000}, job.StopRules{Rounds: 3}, ""},
		{"stopped by too many", path, job.StopRules{SamplesPerPixel: 1000}, job.StopRules{Rounds: 20}, "at most 100"},
		{"stopped by count", path, job.StopRules{SamplesPerPixel: 1000}, job.StopRules{SamplesPerPixel: 10}, ""},
		{"stopped by a large one", path, job.StopRules{SamplesPerPixel: 1000}, job.StopRules{SamplesPerPixel: 500}, "at most 100"},
		{"count and time", path, job.StopRules{SamplesPerPixel: 1000}, job.StopRules{SamplesPerPixel: 500, TimeSeconds: 1}, "at most 100"},
		{"stopped by time", path, job.StopRules{TimeSeconds: 5}, job.StopRules{TimeSeconds: 5}, ""},
		{"stopped by error", path, job.StopRules{TimeSeconds: 5}, job.StopRules{TargetError: 0.1}, ""},
		{"no rule where time was one", path, job.StopRules{TimeSeconds: 5}, job.StopRules{}, "at most 100"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			spec := recorded(t, job.Request{Integrator: c.integrator, Stop: c.recorded}, 64, 48)
			text, err := FormatResolved(spec)
			if err != nil {
				t.Fatal(err)
			}
			field := ""
			if c.detail != "" {
				field = "resolved"
			}
			r := job.Request{Resolved: text, Stop: c.stop}
			expectField(t, limits.CheckRequest(r), field, c.detail)
			expectField(t, limits.Check(spec, r, scene(64, 48, "")), field, c.detail)
			if err := (Limits{}).CheckRequest(r); err != nil {
				t.Errorf("without limits: %v", err)
			}
		})
	}
	first := recorded(t, job.Request{Integrator: path, Stop: job.StopRules{TimeSeconds: 5}}, 64, 48)
	first.RoundSizes = []uint64{101, 1}
	text, err := FormatResolved(first)
	if err != nil {
		t.Fatal(err)
	}
	expectField(t, limits.CheckRequest(job.Request{Resolved: text, Stop: job.StopRules{TimeSeconds: 5}}), "resolved", "101.0")
}
