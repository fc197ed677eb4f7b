package explain_test

import (
	"testing"

	"metrofarm/services/internal/explain"
	"metrofarm/services/internal/job"
)

func TestChoicesNameTheirSource(t *testing.T) {
	depth := 5
	snapshot := job.Snapshot{
		Request: job.Request{Integrator: "auto", MaxDepth: &depth, Width: 64, ShutterOpen: new(float64), ShutterCurve: "0,1"},
		Resolved: `{"integrator":"INTEGRATOR_PSSMLT","maxDepth":5,"width":64,"height":48,
			"unit":0.25,"chainGroups":16,"shutterOpen":0,"shutterCurve":"SHUTTER_CURVE_TABULATED","shutterSamples":[0,1],
			"brandNew":true}`,
	}
	choices, err := explain.Choices(snapshot)
	if err != nil {
		t.Fatal(err)
	}
	want := map[string][2]string{
		"integrator": {"pssmlt", "plan"}, "max_depth": {"5", "request"}, "width": {"64", "request"},
		"height": {"48", "scene"}, "unit": {"0.25", "bootstrap"}, "chain_groups": {"16", "plan"},
		"shutter_open": {"0", "request"}, "shutter_curve": {"tabulated", "request"}, "shutter_samples": {"[0,1]", "request"},
		"brand_new": {"true", "plan"},
	}
	if len(choices) != len(want) {
		t.Errorf("%d choices, want %d", len(choices), len(want))
	}
	for _, choice := range choices {
		if got := [2]string{choice.Value, choice.Source}; got != want[choice.Name] {
			t.Errorf("%s: %v, want %v", choice.Name, got, want[choice.Name])
		}
	}
}

func TestRepeatedJobsComeFromTheirSpec(t *testing.T) {
	resolved := `{"width":64}`
	choices, err := explain.Choices(job.Snapshot{
		Request: job.Request{Resolved: resolved}, Resolved: resolved,
	})
	if err != nil || len(choices) != 1 || choices[0].Source != "resolved" {
		t.Errorf("choices %+v, error %v", choices, err)
	}
}

func TestUnresolvedJobsHaveNoChoices(t *testing.T) {
	choices, err := explain.Choices(job.Snapshot{})
	if err != nil || choices == nil || len(choices) != 0 {
		t.Errorf("choices %v, error %v", choices, err)
	}
	if _, err := explain.Choices(job.Snapshot{Resolved: "{"}); err == nil {
		t.Error("a broken spec was accepted")
	}
}
