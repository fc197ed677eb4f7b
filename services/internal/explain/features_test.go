package explain_test

import (
	"strings"
	"testing"

	"metrofarm/services/internal/explain"
	"metrofarm/services/internal/job"
)

const (
	glassBox = `{"sensor":"thinlens","textures":{"bitmap":2},"instances":3,"structure":{"lens":true,"masked_shapes":1,
		"delta_shapes":4,"shapes":4,"extended_lights":2,"environment_maps":1,"distant_lights":1}}`
	lamp = `{"sensor":"perspective","structure":{"shapes":9,"delta_shapes":1,"delta_lights":1}}`
)

func features(t *testing.T, resolved, report string) map[string]explain.Feature {
	t.Helper()
	p, err := explain.Of(job.Snapshot{ID: "j", Resolved: resolved}, report)
	if err != nil {
		t.Fatal(err)
	}
	byName := make(map[string]explain.Feature)
	for _, f := range p.Features {
		if byName[f.Name].Name != "" || f.Evidence == "" {
			t.Errorf("%+v comes twice or has no evidence", f)
		}
		byName[f.Name] = f
	}
	return byName
}

func TestFeatures(t *testing.T) {
	path := `{"integrator":"INTEGRATOR_PATH","lightSampling":"LIGHT_SAMPLING_MIS","maxDepth":-1}`
	bsdf := `{"integrator":"INTEGRATOR_PATH","lightSampling":"LIGHT_SAMPLING_BSDF","maxDepth":-1}`
	direct := `{"integrator":"INTEGRATOR_BDPT","lightSampling":"LIGHT_SAMPLING_MIS","maxDepth":1}`
	mmlt := `{"integrator":"INTEGRATOR_MMLT","lightSampling":"LIGHT_SAMPLING_MIS","maxDepth":4,"chainGroups":16,"groupSize":64,
		"lengthProbabilities":[0,0.5,0.25,0.25],"delayedRejection":{"enabled":true,"acceptanceRule":"ACCEPTANCE_RULE_GREEN_MIRA"}}`
	chains := `{"integrator":"INTEGRATOR_PSSMLT","under":"UNDER_BDPT","chainGroups":16,"groupSize":64,"directSizes":["2"],
		"targetMap":{"side":1,"values":[1]},"kernel":{"eyeStepProbability":0.25}}`
	for _, c := range []struct{ spec, report, feature, state, evidence string }{
		{path, glassBox, "time", "skipped", "nothing moves"},
		{path, `{"structure":{"motion":true,"moving":[{"end":1}]}}`, "time", "skipped", "instant"},
		{path, `{"shutter_close":0.5,"structure":{"motion":true,"moving":[{"begin":0.25,"end":1}]}}`, "time", "used", "from 0.25 to 1 s"},
		{path, glassBox, "lens", "used", "thinlens"},
		{path, lamp, "lens", "skipped", "perspective"},
		{path, glassBox, "textures", "used", "2 bitmap"},
		{path, lamp, "textures", "skipped", "none"},
		{path, glassBox, "instances", "used", "3 placements"},
		{path, glassBox, "alpha and mask choice", "used", "1 of 4"},
		{path, lamp, "alpha and mask choice", "skipped", "lets rays through"},
		{path, glassBox, "environment tables", "used", "1 environment made"},
		{path, lamp, "environment tables", "skipped", "no environment"},
		{path, glassBox, "light sampling", "skipped", "all 4 shapes"},
		{path, lamp, "light sampling", "used", "1 light"},
		{bsdf, lamp, "light sampling", "skipped", "leaves out 1 light without extent"},
		{direct, lamp, "light sampling", "skipped", "max_depth is 1"},
		{path, lamp, "lights seen directly", "skipped", "no light that a ray can hit"},
		{path, `{"structure":{"extended_lights":1,"hide_emitters":true}}`, "lights seen directly", "skipped", "hides"},
		{path, lamp, "lights hit by scattered rays", "skipped", "no light that a ray can hit"},
		{path, lamp, "light subpaths", "skipped", "path traces from the camera only"},
		{mmlt, glassBox, "light subpaths", "used", "2 lights, 1 at infinity"},
		{mmlt, glassBox, "camera connections", "skipped", "all 4 shapes"},
		{mmlt, lamp, "camera connections", "used", "8 of 9"},
		{path, lamp, "chains", "skipped", "independent"},
		{mmlt, lamp, "chains", "used", "1024 chains over single techniques"},
		{mmlt, lamp, "delayed rejection", "used", "green-mira"},
		{mmlt, lamp, "path lengths", "used", "without 1"},
		{path, lamp, "equalized target", "skipped", "independent"},
		{mmlt, lamp, "equalized target", "skipped", "luminance"},
		{mmlt, lamp, "direct light apart", "skipped", "not asked for"},
		{mmlt, lamp, "subpath steps", "skipped", "not asked for"},
		{chains, lamp, "equalized target", "used", "1 x 1"},
		{chains, lamp, "direct light apart", "used", "3 edges"},
		{chains, lamp, "subpath steps", "used", "eye with probability 0.25, light with 0"},
	} {
		if got := features(t, c.spec, c.report)[c.feature]; got.State != c.state || !strings.Contains(got.Evidence, c.evidence) {
			t.Errorf("%s: %+v, want %s: %s", c.feature, got, c.state, c.evidence)
		}
	}
}

func TestDecisionIsToldApart(t *testing.T) {
	p, err := explain.Of(job.Snapshot{Resolved: `{"integrator":"INTEGRATOR_PSSMLT",
		"autoDecision":{"pilotSamples":"16384","topShare":0.5,"reason":"sparks"}}`}, lamp)
	if err != nil || p.Auto == nil || p.Auto.Integrator != "pssmlt" || p.Auto.PilotSamples != 16384 || p.Auto.Reason != "sparks" {
		t.Errorf("%+v, error %v", p.Auto, err)
	}
	for _, choice := range p.Choices {
		if choice.Name == "auto_decision" {
			t.Error("the decision is listed among what decides the image")
		}
	}
}
