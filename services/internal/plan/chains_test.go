package plan

import (
	"errors"
	"math"
	"strings"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/tally"
)

func TestKernelsTakeTheirOwnSize(t *testing.T) {
	for _, c := range []struct {
		request job.Request
		want    *jobv1.Kernel
	}{
		{job.Request{}, &jobv1.Kernel{Kind: 1, S1: job.KelemenS1, S2: job.KelemenS2, LargeStepProbability: 0.3}},
		{job.Request{Kernel: "gaussian", Sigma: 0.02}, &jobv1.Kernel{Kind: 2, Sigma: 0.02, LargeStepProbability: 0.3}},
		{job.Request{Kernel: "kelemen-coordinate"}, &jobv1.Kernel{Kind: 3, S1: job.KelemenS1, S2: job.KelemenS2, LargeStepProbability: 0.3}},
		{job.Request{Kernel: "wrapped-cauchy", LargeStepProbability: 0.5}, &jobv1.Kernel{Kind: 4, Scale: 0.01, LargeStepProbability: 0.5}},
		{job.Request{Kernel: "uniform", HalfWidth: 0.1}, &jobv1.Kernel{Kind: 5, HalfWidth: 0.1, LargeStepProbability: 0.3}},
	} {
		got := kernel(c.request)
		if got.String() != c.want.String() || checkKernel(got) != "" {
			t.Errorf("%+v: %v, not %v", c.request, got, c.want)
		}
	}
}

func TestSecondStages(t *testing.T) {
	if delayedRejection(job.Request{DelayedRejection: "auto"}) != nil {
		t.Error("a second stage that nobody asked for")
	}
	for _, c := range []struct {
		kernel, stage, rule string
		want                jobv1.AcceptanceRule
		concentration       float64
	}{
		{"", "", "", jobv1.AcceptanceRule_ACCEPTANCE_RULE_ORBITAL, math.Exp(-0.25)},
		{"gaussian", "von-mises", "", jobv1.AcceptanceRule_ACCEPTANCE_RULE_ORBITAL, defaultKappa},
		{"wrapped-cauchy", "", "", jobv1.AcceptanceRule_ACCEPTANCE_RULE_TIERNEY_MIRA, math.Exp(-0.25)},
		{"uniform", "local", "green-mira", jobv1.AcceptanceRule_ACCEPTANCE_RULE_GREEN_MIRA, 0},
		{"gaussian", "local", "", jobv1.AcceptanceRule_ACCEPTANCE_RULE_TIERNEY_MIRA, 0},
		{"", "", "tierney-mira", jobv1.AcceptanceRule_ACCEPTANCE_RULE_TIERNEY_MIRA, math.Exp(-0.25)},
	} {
		r := job.Request{DelayedRejection: "on", Kernel: c.kernel, SecondStage: c.stage, AcceptanceRule: c.rule}
		d := delayedRejection(r)
		if d.AcceptanceRule != c.want || d.LocalScale != 0.25 || d.Concentration != c.concentration || checkSecondStage(d, kernel(r).Kind) != "" {
			t.Errorf("%+v: %v", c, d)
		}
	}
}

func TestMultiplexedPathsAreLimited(t *testing.T) {
	depth := func(n int) *int { return &n }
	for _, c := range []struct {
		scene    int32
		request  *int
		want     int32
		warnings int
	}{
		{-1, nil, 32, 0}, {65, nil, 32, 1}, {8, nil, 8, 0}, {0, nil, 1, 0}, {65, depth(-1), 32, 0}, {8, depth(32), 32, 0},
	} {
		report := scene(64, 64, "path")
		report.MaxDepth = c.scene
		spec, warnings, err := Resolve(job.Request{Integrator: "mmlt", MaxDepth: c.request}, report)
		if err != nil || spec.MaxDepth != c.want || len(warnings) != c.warnings {
			t.Errorf("%+v: depth %d, warnings %q, error %v", c, spec.GetMaxDepth(), warnings, err)
		}
	}
	_, _, err := Resolve(job.Request{Integrator: "mmlt", MaxDepth: depth(33)}, scene(64, 64, ""))
	var wrong *job.FieldError
	if !errors.As(err, &wrong) || wrong.Field != "max_depth" {
		t.Errorf("33 edges: %v", err)
	}
	for _, r := range []job.Request{{Integrator: "path"}, {Integrator: "bdpt"}, {Integrator: "pssmlt", Under: "bdpt"}} {
		if spec := resolve(t, r, scene(64, 64, "")); spec.MaxDepth != -1 {
			t.Errorf("%s is limited to %d edges", r.Integrator, spec.MaxDepth)
		}
	}
}

func TestUselessOptionsAreTold(t *testing.T) {
	r := job.Request{Integrator: "path", Kernel: "gaussian", AfterLargeSteps: true}
	_, warnings, err := Resolve(r, scene(64, 64, ""))
	if err != nil || len(warnings) != 1 || !strings.Contains(warnings[0], "kernel, after_large_steps") {
		t.Errorf("warnings %q, error %v", warnings, err)
	}
}

func TestLengthsShareTheBootstrapEvenly(t *testing.T) {
	for depth := 1; depth <= LongestMultiplexed; depth++ {
		spec := resolve(t, job.Request{Integrator: "mmlt", MaxDepth: &depth, BootstrapSamples: 5000}, scene(64, 64, ""))
		m := spec.BootstrapSamples
		if m < 5000 || m%uint64(16*depth) != 0 || m%(2*GroupSize) != 0 || m > 5000+128*uint64(depth) {
			t.Errorf("%d lengths: %d samples", depth, m)
		}
	}
}

// sums of samples with this mean.
func sums(mean float64) tally.Sums { return tally.Sums{Count: 10, Sum: 10 * mean} }

func TestLengthProbabilities(t *testing.T) {
	lit := &scenev1.SceneReport{Structure: &scenev1.Structure{ExtendedLights: 1}}
	points := &scenev1.SceneReport{Structure: &scenev1.Structure{DeltaLights: 1}}
	hidden := &scenev1.SceneReport{Structure: &scenev1.Structure{ExtendedLights: 1, HideEmitters: true}}
	for name, c := range map[string]struct {
		report *scenev1.SceneReport
		means  []float64
		want   []float64
	}{
		"proportional with a floor":    {lit, []float64{1, 2, 1, 0}, []float64{0.25, 0.475, 0.25, 0.025}},
		"nothing to see directly":      {points, []float64{0, 3, 1}, []float64{0, 0.725, 0.275}},
		"hidden lights":                {hidden, []float64{0, 1}, []float64{0, 1}},
		"what was seen is possible":    {points, []float64{1, 1}, []float64{0.5, 0.5}},
		"without light all are alike":  {lit, []float64{0, 0}, []float64{0.5, 0.5}},
		"without light, but the first": {points, []float64{0, 0, 0}, []float64{0, 0.5, 0.5}},
		"unknown structure":            {&scenev1.SceneReport{}, []float64{0, 1}, []float64{0.05, 0.95}},
	} {
		var all []tally.Sums
		for _, mean := range c.means {
			all = append(all, sums(mean))
		}
		spec := &jobv1.ResolvedSpec{}
		SetLengths(spec, all, c.report)
		total := 0.0
		for k, p := range spec.LengthProbabilities {
			total += p
			if math.Abs(p-c.want[k]) > 1e-12 {
				t.Errorf("%s: %v, not %v", name, spec.LengthProbabilities, c.want)
			}
		}
		if math.Abs(total-1) > 1e-12 {
			t.Errorf("%s: the sum is %v", name, total)
		}
	}
	kept := &jobv1.ResolvedSpec{LengthProbabilities: []float64{0.1, 0.9}}
	if SetLengths(kept, []tally.Sums{sums(1), sums(1)}, lit); kept.LengthProbabilities[0] != 0.1 {
		t.Error("a repeated job lost its probabilities")
	}
}

func TestMultiplexedSpecsAreChecked(t *testing.T) {
	depth := 3
	spec := resolve(t, job.Request{Integrator: "mmlt", MaxDepth: &depth}, scene(64, 64, ""))
	spec.Unit = 1
	SetLengths(spec, []tally.Sums{sums(1), sums(2), sums(1)}, &scenev1.SceneReport{})
	if detail := checkSpec(spec); detail != "" {
		t.Fatal(detail)
	}
	for field, damage := range map[string]func(){
		"length_probabilities": func() { spec.LengthProbabilities[0] += 1e-6 },
		"technique_coordinate": func() { spec.TechniqueCoordinate = 0 },
		"bootstrap_samples":    func() { spec.BootstrapSamples += 128 },
		"light_sampling":       func() { spec.LightSampling = jobv1.LightSampling_LIGHT_SAMPLING_BSDF },
		"max_depth":            func() { spec.MaxDepth = -1 },
	} {
		before, err := FormatResolved(spec)
		if err != nil {
			t.Fatal(err)
		}
		damage()
		if detail := checkSpec(spec); !strings.Contains(detail, field) {
			t.Errorf("%s: %q", field, detail)
		}
		if spec, err = ParseResolved(before); err != nil {
			t.Fatal(err)
		}
	}
}
