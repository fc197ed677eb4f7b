package plan

import (
	"math"
	"reflect"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
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

// pilotOf a square image.
func pilotOf(side uint32, depth int32) *jobv1.ResolvedSpec {
	return &jobv1.ResolvedSpec{Width: side, Height: side, MaxDepth: depth}
}

func solid() *scenev1.SceneReport {
	return &scenev1.SceneReport{Structure: &scenev1.Structure{Shapes: 2, DeltaShapes: 1}}
}

func TestAutoRule(t *testing.T) {
	for name, c := range map[string]struct {
		values []float32
		want   string
		top    float64
		zero   float64
	}{
		"even light":           {values(10000, 0, 0, 10000), "path", 8. / 9998, 0},
		"mostly dark, even":    {values(10000, 0, 0, 500), "path", 8. / 498, 0.95},
		"a visible light":      {values(10000, 100, 50, 9000), "path", 400. / 13900, 0.09},
		"sparks":               {values(10000, 5, 2000, 9000), "mmlt", 6005. / 15000, 0.0995},
		"sparks in the dark":   {values(10000, 5, 2000, 100), "mmlt", 6005. / 6100, 0.9895},
		"one spark":            {values(10000, 1, 1e6, 8999), "path", 8. / 8998, 0.1},
		"nothing but a spark":  {values(10000, 1, 1, 0), "mmlt", 1, 0.9999},
		"nothing":              {values(10000, 0, 0, 0), "mmlt", 0, 1},
		"fewer than the bound": {values(100, 1, 1, 0), "mmlt", 1, 0.99},
	} {
		got, d := Decide(job.Request{}, pilotOf(256, -1), c.values, solid())
		if got.Integrator != c.want || math.Abs(d.TopShare-c.top) > 1e-12 || math.Abs(d.ZeroShare-c.zero) > 1e-12 ||
			d.PilotSamples != uint64(len(c.values)) || d.Reason == "" {
			t.Errorf("%s: %s, %v", name, got.Integrator, d)
		}
	}
}

func TestAutoLooksAtSizeAndSurfaces(t *testing.T) {
	hard := values(10000, 5, 2000, 100)
	glass := &scenev1.SceneReport{Structure: &scenev1.Structure{Shapes: 2, DeltaShapes: 2}}
	for name, c := range map[string]struct {
		asked  job.Request
		pilot  *jobv1.ResolvedSpec
		report *scenev1.SceneReport
		want   job.Request
	}{
		"large":         {job.Request{}, pilotOf(182, -1), solid(), job.Request{Integrator: "mmlt", Target: "equalized", DirectApart: "on"}},
		"small":         {job.Request{}, pilotOf(181, -1), solid(), job.Request{Integrator: "bdpt"}},
		"all glass":     {job.Request{}, pilotOf(181, -1), glass, job.Request{Integrator: "pssmlt", Target: "equalized", DirectApart: "on"}},
		"short paths":   {job.Request{}, pilotOf(256, 2), solid(), job.Request{Integrator: "mmlt", Target: "equalized"}},
		"asked for":     {job.Request{Target: "luminance", DirectApart: "off"}, pilotOf(256, -1), solid(), job.Request{Integrator: "mmlt", Target: "luminance", DirectApart: "off"}},
		"auto is named": {job.Request{Integrator: "auto"}, pilotOf(181, -1), solid(), job.Request{Integrator: "bdpt"}},
	} {
		if got, d := Decide(c.asked, c.pilot, hard, c.report); !reflect.DeepEqual(got, c.want) {
			t.Errorf("%s: %+v, %s", name, got, d.GetReason())
		}
	}
}

func TestRelativeVariance(t *testing.T) {
	_, d := Decide(job.Request{}, pilotOf(256, -1), values(1000, 0, 0, 250), solid())
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
