package plan

import (
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

func TestDirectSamplesFollowTheMutations(t *testing.T) {
	r := job.Request{Integrator: "pssmlt", DirectApart: "on", Stop: job.StopRules{MutationsPerPixel: 400}}
	spec, warnings, err := Resolve(r, scene(320, 240, "path"))
	if err != nil || len(warnings) != 0 {
		t.Fatal(err, warnings)
	}
	spec.Unit = 1
	if detail := checkSpec(spec); detail != "" {
		t.Fatal(detail)
	}
	if Shape(spec).Layers != 3 || spec.DirectSizes[0] < 2 {
		t.Errorf("%d layers, sizes %v", Shape(spec).Layers, spec.DirectSizes)
	}
	var direct uint64
	for _, n := range spec.DirectSizes {
		direct += n
	}
	if direct < 98 || direct > 102 {
		t.Errorf("%d direct samples per pixel for 400 mutations", direct)
	}
}

func TestDirectLightStaysWhereChainsHaveNothingElse(t *testing.T) {
	depth := 2
	spec, warnings, err := Resolve(job.Request{Integrator: "mmlt", DirectApart: "on", MaxDepth: &depth}, scene(320, 240, "path"))
	if err != nil || len(warnings) != 1 || !strings.Contains(warnings[0], "direct_apart") || DirectApart(spec) {
		t.Errorf("%v, %v, %v", spec.GetDirectSizes(), warnings, err)
	}
}

func TestBadDirectSizes(t *testing.T) {
	for name, sizes := range map[string][]uint64{"too few": {2}, "odd": nil, "none at first": nil} {
		spec, _, err := Resolve(job.Request{Integrator: "pssmlt", DirectApart: "on"}, scene(320, 240, "path"))
		if err != nil {
			t.Fatal(err)
		}
		spec.Unit = 1
		switch name {
		case "odd":
			spec.DirectSizes[0] = 3
		case "none at first":
			spec.DirectSizes[0] = 0
		default:
			spec.DirectSizes = sizes
		}
		if detail := checkSpec(spec); !strings.Contains(detail, "direct") {
			t.Errorf("%s: %q", name, detail)
		}
	}
}
