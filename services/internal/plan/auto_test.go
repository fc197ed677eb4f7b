package plan

import (
	"math"
	"testing"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// values of n samples: the first are bright, the next are dim, the rest is dark.
func values(n, bright int, brightness float32, dim int) []float32 {
	v := make([]float32, n)
	for i := range v {
		switch {
		case i < bright:
			v[i] = brightness
		case i < bright+dim:
			v[i] = 1
		}
	}
	return v
}

func TestAutoRule(t *testing.T) {
	for name, c := range map[string]struct {
		values []float32
		want   string
		top    float64
		zero   float64
	}{
		"even light":           {values(10000, 0, 0, 10000), "path", 0.001, 0},
		"mostly dark, even":    {values(10000, 0, 0, 500), "path", 0.02, 0.95},
		"a visible light":      {values(10000, 100, 50, 9000), "path", 500. / 14000, 0.09},
		"sparks":               {values(10000, 5, 2000, 9000), "pssmlt", 10005. / 19000, 0.0995},
		"sparks in the dark":   {values(10000, 5, 2000, 100), "pssmlt", 10005. / 10100, 0.9895},
		"nothing":              {values(10000, 0, 0, 0), "pssmlt", 0, 1},
		"fewer than the bound": {values(100, 1, 1, 0), "pssmlt", 1, 0.99},
	} {
		got, d := Decide(c.values, make([]float32, len(c.values)), &scenev1.SceneReport{})
		if got != c.want || math.Abs(d.TopShare-c.top) > 1e-12 || math.Abs(d.ZeroShare-c.zero) > 1e-12 ||
			d.PilotSamples != uint64(len(c.values)) || d.Reason == "" {
			t.Errorf("%s: %s, %v", name, got, d)
		}
	}
}

// TestLampsAreNotHard: what is seen directly does not count, rounding included.
func TestLampsAreNotHard(t *testing.T) {
	all, lamp := values(10000, 0, 0, 9000), make([]float32, 10000)
	for i := range 5 {
		lamp[i] = 30000
		all[i] += lamp[i] * (1 + 1e-7)
	}
	if got, d := Decide(all, lamp, &scenev1.SceneReport{}); got != "path" || d.TopShare > 0.002 {
		t.Errorf("%s, %v", got, d)
	}
}

func TestRelativeVariance(t *testing.T) {
	_, d := Decide(values(1000, 0, 0, 250), make([]float32, 1000), &scenev1.SceneReport{})
	if want := 0.25 * 0.75 / (0.25 * 0.25); math.Abs(d.RelativeVariance-want) > 1e-12 {
		t.Errorf("relative variance %v of a coin that shows light one time in four, want %v", d.RelativeVariance, want)
	}
}

func TestOnlyOpenQuestionsAreMeasured(t *testing.T) {
	for _, c := range []struct {
		request job.Request
		scene   string
		want    bool
	}{
		{job.Request{}, "path", true},
		{job.Request{Integrator: "auto"}, "volpath", true},
		{job.Request{Integrator: "auto"}, "pssmlt", false},
		{job.Request{Integrator: "path"}, "path", false},
		{job.Request{Integrator: "mmlt"}, "path", false},
		{job.Request{Resolved: "{}"}, "path", false},
	} {
		if got := NeedsPilot(c.request, scene(64, 64, c.scene)); got != c.want {
			t.Errorf("%+v in a scene of %s: %v", c.request, c.scene, got)
		}
	}
}

func TestThePilotIsNoPartOfTheJob(t *testing.T) {
	for _, c := range []struct {
		side    uint32
		samples uint64
	}{{16, 16384}, {200, 40064}, {1000, 65536}} {
		spec, err := Pilot(job.Request{Seed: 5, BootstrapSamples: 1 << 20}, scene(c.side, c.side, "path"))
		if err != nil || spec.BootstrapSamples != c.samples || spec.Seed == 5 {
			t.Errorf("side %d: %d samples, seed %d, error %v", c.side, spec.GetBootstrapSamples(), spec.GetSeed(), err)
		}
	}
}
