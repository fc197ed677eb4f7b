package plan

import (
	"slices"
	"strings"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

func TestTargetMapIsSmoothFlooredAndAtMostOne(t *testing.T) {
	sums := make([]float64, MapSide*MapSide)
	sums[20*MapSide+30] = 1000
	for i := range sums {
		if i/MapSide >= 50 {
			sums[i] = 1
		}
	}
	spec := &jobv1.ResolvedSpec{}
	SetTarget(spec, sums)
	m := spec.GetTargetMap()
	if detail := checkMap(m); detail != "" {
		t.Fatal(detail)
	}
	values := m.GetValues()
	if slices.Max(values) != 1 || values[20*MapSide+30] != 1 {
		t.Errorf("the largest value is %v, at the bright cell %v", slices.Max(values), values[20*MapSide+30])
	}
	// Two passes of 1 2 1: binomials of 4, per axis.
	if got := values[20*MapSide+31]; got != 4.0/6 {
		t.Errorf("beside the bright cell %v", got)
	}
	mean := 0.0
	for _, v := range values {
		mean += float64(v) / float64(len(values))
	}
	dark, lit := float64(values[0]), float64(values[60*MapSide])
	if dark < 0.01*mean || dark > 0.03*mean || lit < dark {
		t.Errorf("floor %v of mean %v, lit %v", dark, mean, lit)
	}
}

func TestWithoutLightThereIsNoMap(t *testing.T) {
	spec := &jobv1.ResolvedSpec{}
	SetTarget(spec, make([]float64, MapSide*MapSide))
	if spec.TargetMap != nil {
		t.Error(spec.TargetMap)
	}
}

func TestMapPilotSeesAllLight(t *testing.T) {
	r := job.Request{Integrator: "pssmlt", DirectApart: "on", Target: "equalized", Seed: 3}
	spec, _, err := Resolve(r, scene(320, 240, "path"))
	if err != nil || !NeedsMap(spec, r) {
		t.Fatal(err, "no map needed")
	}
	pilot := MapPilot(spec)
	if DirectApart(pilot) || pilot.Seed == spec.Seed || !DirectApart(spec) {
		t.Errorf("%v", pilot)
	}
	r.Resolved = "{}"
	if NeedsMap(spec, r) {
		t.Error("a repeated job has its map")
	}
}

func TestBadMaps(t *testing.T) {
	for _, m := range []*jobv1.TargetMap{
		{}, {Side: 65, Values: make([]float32, 65*65)}, {Side: 2, Values: []float32{1, 1, 1}}, {Side: 1, Values: []float32{0}}, {Side: 1, Values: []float32{1.5}},
	} {
		if detail := checkMap(m); !strings.Contains(detail, "target_map") {
			t.Errorf("%v: %q", m, detail)
		}
	}
}
