package plan

import (
	"errors"
	"slices"
	"testing"

	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

func scene(width, height uint32, integrator string) *scenev1.SceneReport {
	return &scenev1.SceneReport{
		Width: width, Height: height, Filter: scenev1.Filter_FILTER_GAUSSIAN, FilterRadius: 2,
		MaxDepth: -1, RrDepth: 5, SampleCount: 64, Integrator: integrator,
	}
}

func resolve(t *testing.T, r job.Request, report *scenev1.SceneReport) *jobv1.ResolvedSpec {
	t.Helper()
	spec, _, err := Resolve(r, report)
	if err != nil {
		t.Fatal(err)
	}
	return spec
}

func sum(sizes []uint64) (total uint64) {
	for _, n := range sizes {
		total += n
	}
	return total
}

func TestChainGroupsAndBootstrap(t *testing.T) {
	for _, c := range []struct {
		width, height uint32
		chains        uint64
		groups        uint32
		samples       uint64
	}{
		{16, 16, 0, 16, 65536},
		{256, 256, 0, 32, 262144},
		{1920, 1080, 0, 256, 1 << 20},
		{256, 256, 1, 16, 262144},
		{256, 256, 4097, 80, 262144},
		{64, 64, 65536, 1024, 32 * 65536},
	} {
		spec := resolve(t, job.Request{Integrator: "pssmlt", Chains: c.chains}, scene(c.width, c.height, ""))
		if spec.ChainGroups != c.groups || spec.BootstrapSamples != c.samples {
			t.Errorf("%+v: %d groups, %d samples", c, spec.ChainGroups, spec.BootstrapSamples)
		}
	}
}

func TestRoundsSumToTheCount(t *testing.T) {
	for _, count := range []uint64{1, 3, 4, 5, 16, 17, 1000, 123457} {
		paths := resolve(t, job.Request{Integrator: "path", Stop: job.StopRules{SamplesPerPixel: count}}, scene(100, 50, ""))
		if got := sum(paths.RoundSizes); got != count {
			t.Errorf("path: %d samples, not %d", got, count)
		}
		chains := resolve(t, job.Request{Integrator: "pssmlt", Stop: job.StopRules{MutationsPerPixel: count}}, scene(100, 50, ""))
		want := (count*5000 + 1023) / 1024
		n := len(chains.RoundSizes)
		whole := resolve(t, job.Request{Integrator: "pssmlt", Stop: job.StopRules{Rounds: 1}}, scene(100, 50, "")).RoundSizes[:n]
		cut := chains.RoundSizes[n-1] != whole[n-1]
		if !slices.Equal(chains.RoundSizes[:n-1], whole[:n-1]) || chains.RoundSizes[n-1] > whole[n-1] {
			t.Errorf("pssmlt: rounds %v do not begin %v", chains.RoundSizes, whole)
		}
		if got := sum(chains.RoundSizes); got < want || got >= want+CutMultiple || cut && got%CutMultiple != 0 || sum(chains.RoundSizes[:n-1]) >= want {
			t.Errorf("pssmlt: %d mutations per chain, not %d", got, want)
		}
		for r, n := range chains.RoundSizes {
			if n == 0 {
				t.Errorf("round %d is empty", r)
			}
		}
	}
}

func TestRoundsGrow(t *testing.T) {
	spec := resolve(t, job.Request{Integrator: "path", Stop: job.StopRules{TargetError: 0.1}}, scene(100, 50, ""))
	if len(spec.RoundSizes) != 64 || spec.RoundSizes[0] != 4 {
		t.Fatalf("rounds %v", spec.RoundSizes)
	}
	for r := 1; r < 64; r++ {
		if n, last := float64(spec.RoundSizes[r]), float64(spec.RoundSizes[r-1]); n < 1.35*last || n >= 1.35*last+1 {
			t.Errorf("round %d has %v after %v", r, n, last)
		}
	}
}

func TestSceneDecidesWhereTheRequestDoesNot(t *testing.T) {
	spec := resolve(t, job.Request{Integrator: "path"}, scene(100, 50, ""))
	if spec.Integrator != jobv1.Integrator_INTEGRATOR_PATH || sum(spec.RoundSizes) != 64 || spec.MaxDepth != -1 ||
		spec.LightSampling != jobv1.LightSampling_LIGHT_SAMPLING_MIS {
		t.Errorf("%v", spec)
	}
	for name, want := range map[string]jobv1.Integrator{
		"pssmlt": jobv1.Integrator_INTEGRATOR_PSSMLT, "bdpt": jobv1.Integrator_INTEGRATOR_BDPT, "mmlt": jobv1.Integrator_INTEGRATOR_MMLT,
	} {
		report := scene(100, 50, name)
		if NeedsPilot(job.Request{}, report) {
			t.Errorf("a scene that names %s is measured", name)
		}
		if spec := resolve(t, job.Request{Integrator: "auto"}, report); spec.Integrator != want {
			t.Errorf("%s: %v", name, spec)
		}
	}
}

func TestSegmentsCoverTheCells(t *testing.T) {
	for _, size := range []uint32{1, 7, 100, 1000} {
		report := scene(size, size, "path")
		spec := resolve(t, job.Request{Integrator: "bdpt"}, report)
		cells := Cells(spec, report)
		if want := int(size+4) * int(size+4); cells != want {
			t.Errorf("%d cells, not %d", cells, want)
		}
		perSegment := int(spec.BlocksPerSegment) * GroupSize
		if n := Segments(spec, cells); n < 1 || n*perSegment < cells || (n-1)*perSegment >= cells {
			t.Errorf("size %d: %d segments of %d cells for %d", size, n, perSegment, cells)
		}
	}
}

func TestBootstrapRangesPartitionTheHalves(t *testing.T) {
	for _, samples := range []uint64{128, 640, 65536, 1 << 20, 1<<24 - 128} {
		spec := &jobv1.ResolvedSpec{BootstrapSamples: samples, GroupSize: GroupSize}
		next := uint64(0)
		for _, r := range BootstrapRanges(spec) {
			last := r.First + uint64(r.Count) - 1
			if r.First != next || r.Count == 0 || r.Count > 65536 || r.Count%GroupSize != 0 || r.First/(samples/2) != last/(samples/2) {
				t.Fatalf("%d samples: range %+v", samples, r)
			}
			next = last + 1
		}
		if next != samples {
			t.Errorf("ranges end at %d, not %d", next, samples)
		}
	}
}

func TestUnit(t *testing.T) {
	chains, paths := jobv1.Integrator_INTEGRATOR_PSSMLT, jobv1.Integrator_INTEGRATOR_PATH
	for _, c := range []struct {
		integrator jobv1.Integrator
		given      float64
		mean, want float64
		black      bool
	}{
		{chains, 0, 3, 3, false},
		{chains, 2, 3, 2, false},
		{chains, 0, 0, 1, true},
		{paths, 0, 3, 768, false},
		{paths, 0, 0, 1, false},
	} {
		spec := &jobv1.ResolvedSpec{Integrator: c.integrator, Unit: c.given}
		warning, black := SetUnit(spec, c.mean)
		if spec.Unit != c.want || black != c.black || (warning == "") != (c.mean > 0) {
			t.Errorf("%+v: unit %v, black %v, warning %q", c, spec.Unit, black, warning)
		}
	}
}

func TestResolvedRoundTripAndRefusals(t *testing.T) {
	spec := resolve(t, job.Request{Integrator: "pssmlt", Seed: 1<<64 - 1}, scene(100, 50, ""))
	SetUnit(spec, 0.1)
	text, err := FormatResolved(spec)
	if err != nil {
		t.Fatal(err)
	}
	if again, err := ParseResolved(text); err != nil || !proto.Equal(again, spec) {
		t.Fatalf("%v, error %v", again, err)
	}
	for name, damage := range map[string]func(*jobv1.ResolvedSpec){
		"unit":       func(s *jobv1.ResolvedSpec) { s.Unit = 0 },
		"integrator": func(s *jobv1.ResolvedSpec) { s.Integrator = 0 },
		"rounds":     func(s *jobv1.ResolvedSpec) { s.RoundSizes = nil },
		"size":       func(s *jobv1.ResolvedSpec) { s.RoundSizes[0] = 0 },
		"groups":     func(s *jobv1.ResolvedSpec) { s.ChainGroups = 17 },
		"bootstrap":  func(s *jobv1.ResolvedSpec) { s.BootstrapSamples += 64 },
		"kernel":     func(s *jobv1.ResolvedSpec) { s.Kernel.S1 = s.Kernel.S2 },
		"under":      func(s *jobv1.ResolvedSpec) { s.Under = 0 },
		"weights":    func(s *jobv1.ResolvedSpec) { s.LayerWeights = 0 },
		"techniques": func(s *jobv1.ResolvedSpec) {
			s.Under, s.LightSampling = jobv1.Under_UNDER_BDPT, jobv1.LightSampling_LIGHT_SAMPLING_BSDF
		},
		"rule": func(s *jobv1.ResolvedSpec) {
			s.DelayedRejection = delayedRejection(job.Request{DelayedRejection: "on"})
			s.DelayedRejection.AcceptanceRule = 0
		},
		"move": func(s *jobv1.ResolvedSpec) {
			s.DelayedRejection = delayedRejection(job.Request{DelayedRejection: "on"})
			s.DelayedRejection.Move = jobv1.SecondMove_SECOND_MOVE_LOCAL
		},
		"orbital green-mira": func(s *jobv1.ResolvedSpec) {
			s.DelayedRejection = delayedRejection(job.Request{DelayedRejection: "on"})
			s.DelayedRejection.AcceptanceRule = jobv1.AcceptanceRule_ACCEPTANCE_RULE_GREEN_MIRA
		},
		"biased": func(s *jobv1.ResolvedSpec) {
			s.DelayedRejection = delayedRejection(job.Request{DelayedRejection: "on"})
			s.Kernel.Kind = jobv1.KernelKind_KERNEL_KIND_KELEMEN_COORDINATE
		},
		"width": func(s *jobv1.ResolvedSpec) { s.Width = 40000 },
	} {
		bad := proto.CloneOf(spec)
		damage(bad)
		text, _ := FormatResolved(bad)
		var wrong *job.FieldError
		if _, err := ParseResolved(text); !errors.As(err, &wrong) {
			t.Errorf("%s: %v", name, err)
		}
	}
}
