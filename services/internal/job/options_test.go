package job

import (
	"errors"
	"reflect"
	"strings"
	"testing"
)

// jsonFields lists the fields of a document, those of its objects with their name before a dot.
func jsonFields(t reflect.Type, prefix string) []string {
	var names []string
	for i := range t.NumField() {
		field := t.Field(i)
		name, _, _ := strings.Cut(field.Tag.Get("json"), ",")
		if field.Type.Kind() == reflect.Struct {
			names = append(names, jsonFields(field.Type, name+".")...)
			continue
		}
		names = append(names, prefix+name)
	}
	return names
}

func TestEveryFieldIsAnOption(t *testing.T) {
	options := map[string]bool{"scene": true, "entry": true, "inspect_only": true, "priority": true, "resolved": true}
	flags := map[string]bool{}
	for _, o := range Options() {
		if options[o.Field] || flags[o.Flag] {
			t.Errorf("%s comes twice", o.Field)
		}
		options[o.Field], flags[o.Flag] = true, true
	}
	for _, field := range jsonFields(reflect.TypeFor[Request](), "") {
		if !options[field] {
			t.Errorf("%s is no option", field)
		}
		delete(options, field)
	}
	for field := range options {
		t.Errorf("option %s has no field", field)
	}
}

func TestRefusalsNameTheField(t *testing.T) {
	for name, c := range map[string]struct {
		request Request
		field   string
		says    string
	}{
		"word":                  {Request{Integrator: "magic"}, "integrator", "mmlt"},
		"under path":            {Request{Integrator: "path", Under: "bdpt"}, "under", "belongs to pssmlt"},
		"under mmlt":            {Request{Integrator: "mmlt", Under: "path"}, "under", "belongs to pssmlt"},
		"light sampling":        {Request{Integrator: "bdpt", LightSampling: "bsdf"}, "light_sampling", "path and pssmlt"},
		"light sampling, under": {Request{Integrator: "pssmlt", Under: "bdpt", LightSampling: "mis"}, "light_sampling", "every technique"},
		"second stage of path":  {Request{Integrator: "path", DelayedRejection: "on"}, "delayed_rejection", "pssmlt and mmlt"},
		"technique":             {Request{Integrator: "pssmlt", TechniqueCoordinate: "frozen"}, "technique_coordinate", "mmlt"},
		"mutations":             {Request{Integrator: "bdpt", Stop: StopRules{MutationsPerPixel: 1}}, "stop.mutations_per_pixel", "pssmlt and mmlt"},
		"samples":               {Request{Integrator: "mmlt", Stop: StopRules{SamplesPerPixel: 1}}, "stop.samples_per_pixel", "path and bdpt"},
		"layer":                 {Request{Integrator: "mmlt", Layers: []string{"acceptance", "depth"}}, "layers", "techniques"},
		"layers again":          {Request{Layers: []string{"acceptance", "acceptance", "acceptance"}}, "layers", "no more than 2"},
		"defaults": {
			Request{Defaults: map[string]string{"a": strings.Repeat("x", 32<<10), "b": strings.Repeat("x", 32<<10)}},
			"defaults", "65538 bytes; at most 65536",
		},
		"layers of path":       {Request{Integrator: "path", Layers: []string{"acceptance"}}, "layers", "pssmlt and mmlt"},
		"techniques of pssmlt": {Request{Integrator: "pssmlt", Layers: []string{"techniques"}}, "layers", "belong to mmlt"},
		"sigma":                {Request{Sigma: 0.1}, "sigma", "gaussian"},
		"scale":                {Request{Kernel: "gaussian", Scale: 0.1}, "scale", "wrapped-cauchy"},
		"large scale":          {Request{Kernel: "wrapped-cauchy", Scale: 0.25}, "scale", "0.25"},
		"half width":           {Request{Kernel: "uniform", HalfWidth: -1}, "half_width", "0.5"},
		"stage without":        {Request{SecondStage: "von-mises"}, "second_stage", "delayed_rejection on"},
		"rule without":         {Request{AcceptanceRule: "orbital", DelayedRejection: "off"}, "acceptance_rule", "delayed_rejection on"},
		"large without":        {Request{AfterLargeSteps: true}, "after_large_steps", "delayed_rejection on"},
		"rho":                  {Request{DelayedRejection: "on", Concentration: 1}, "concentration", "rho"},
		"kappa":                {Request{DelayedRejection: "on", SecondStage: "von-mises", Concentration: -1}, "concentration", "kappa"},
		"biased": {
			Request{DelayedRejection: "on", Kernel: "wrapped-cauchy", AcceptanceRule: "orbital"},
			"acceptance_rule", "use tierney-mira, or kernel kelemen or gaussian",
		},
		"biased after a local move": {
			Request{DelayedRejection: "on", SecondStage: "local", AcceptanceRule: "orbital"},
			"acceptance_rule", "use tierney-mira or green-mira",
		},
		"biased on an orbit": {
			Request{DelayedRejection: "on", AcceptanceRule: "green-mira"}, "acceptance_rule", "or second_stage local",
		},
		"local scale of an orbit": {Request{DelayedRejection: "on", LocalScale: 0.5}, "local_scale", "after_large_steps"},
		"large local scale":       {Request{DelayedRejection: "on", SecondStage: "local", LocalScale: 2}, "local_scale", "1"},
		"angle of a local move":   {Request{DelayedRejection: "on", SecondStage: "local", Concentration: 0.5}, "concentration", "von-mises"},
		"biased too": {
			Request{DelayedRejection: "on", Kernel: "kelemen-coordinate", AcceptanceRule: "orbital"},
			"acceptance_rule", "would bias",
		},
	} {
		c.request.Scene, c.request.Entry = "aa", "scene.xml"
		var wrong *FieldError
		if err := c.request.Validate(); !errors.As(err, &wrong) || wrong.Field != c.field || !strings.Contains(wrong.Detail, c.says) {
			t.Errorf("%s: %v", name, err)
		}
	}
}

func TestGoodRequests(t *testing.T) {
	for _, r := range []Request{
		{},
		{Integrator: "auto", DelayedRejection: "on"},
		{Defaults: map[string]string{"a": strings.Repeat("x", 64<<10-1)}, Layers: []string{"acceptance", "acceptance"}},
		{Integrator: "bdpt", Stop: StopRules{SamplesPerPixel: 4}},
		{Integrator: "mmlt", TechniqueCoordinate: "mutated", Kernel: "uniform", HalfWidth: 0.1},
		{Integrator: "pssmlt", Under: "bdpt", LayerWeights: "kelemen"},
		{Integrator: "pssmlt", LightSampling: "bsdf", Kernel: "kelemen-coordinate", DelayedRejection: "on"},
		{DelayedRejection: "on", SecondStage: "von-mises", Concentration: 100, AcceptanceRule: "tierney-mira", AfterLargeSteps: true, LocalScale: 0.5},
		{DelayedRejection: "on", SecondStage: "local", AcceptanceRule: "green-mira", Kernel: "uniform"},
	} {
		r.Scene, r.Entry = "aa", "scene.xml"
		if err := r.Validate(); err != nil {
			t.Errorf("%+v: %v", r, err)
		}
	}
}
