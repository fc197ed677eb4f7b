// Package explain tells where each value of a job's resolved spec comes from: what the user asked
// for, what the scene says, what was measured, what is the default.
package explain

import (
	"encoding/json"
	"fmt"
	"slices"
	"strings"
	"unicode"

	"metrofarm/services/internal/job"
)

// Choice is one value that decides the image, and why it is what it is.
type Choice struct {
	// Name of the field of the resolved spec, for example "large_step_probability".
	Name string `json:"name"`
	// Value as text, for example "pssmlt" or "16".
	Value string `json:"value"`
	// Source is request, scene, bootstrap, plan, worker or resolved (an earlier job's spec).
	Source string `json:"source"`
	// Why, for people.
	Why string `json:"why"`
}

// rule says where a field comes from.
type rule struct {
	asked  func(job.Request) bool // nil: cannot be asked for
	source string                 // unless asked for
	why    string                 // unless asked for
}

func rules() map[string]rule {
	asked := func(fields ...string) func(job.Request) bool {
		return func(r job.Request) bool {
			return slices.ContainsFunc(job.Options(), func(o job.Option) bool {
				return slices.Contains(fields, o.Field) && o.Set(&r)
			})
		}
	}
	return map[string]rule{
		"integrator": {
			func(r job.Request) bool { return r.Integrator != "" && r.Integrator != job.IntegratorAuto },
			"plan", "chosen for the scene",
		},
		"under": {asked("under"), "plan", "default"},
		"light_sampling": {
			asked("light_sampling"), "plan", "default: all ways of finding emitters, combined",
		},
		"max_depth":          {asked("max_depth"), "scene", "the scene's setting, within what the integrator takes"},
		"rr_depth":           {nil, "scene", "the scene's setting"},
		"width":              {asked("width"), "scene", "the scene's film"},
		"height":             {asked("height"), "scene", "the scene's film"},
		"seed":               {asked("seed"), "plan", "default"},
		"shutter_open":       {asked("shutter_open"), "scene", "the scene's shutter"},
		"shutter_close":      {asked("shutter_close"), "scene", "the scene's shutter"},
		"shutter_curve":      {asked("shutter_curve"), "plan", "default"},
		"shutter_samples":    {asked("shutter_curve"), "plan", "default"},
		"shutter_ramp_open":  {asked("shutter_ramp_open"), "plan", "default"},
		"shutter_ramp_close": {asked("shutter_ramp_close"), "plan", "default"},
		"exposure":           {asked("exposure"), "plan", "default"},
		"rolling_shutter":    {asked("rolling_shutter"), "plan", "default"},
		"bootstrap_samples":  {asked("bootstrap_samples"), "plan", "default"},
		"group_size":         {nil, "worker", "chains that the workers' build runs side by side"},
		"chain_groups":       {asked("chains"), "plan", "default"},
		"kernel": {
			asked("kernel", "s1", "s2", "sigma", "scale", "half_width", "large_step_probability", "eye_step_probability", "light_step_probability"),
			"plan", "default",
		},
		"delayed_rejection":    {asked("delayed_rejection"), "plan", "default"},
		"layer_weights":        {asked("layer_weights"), "plan", "default"},
		"layers":               {asked("layers"), "plan", "default"},
		"technique_coordinate": {asked("technique_coordinate"), "plan", "default"},
		"length_probabilities": {nil, "bootstrap", "in proportion to each length's share of b, with a floor"},
		"direct_sizes":         {asked("direct_apart"), "plan", "a quarter of a sample for each mutation"},
		"target_map":           {asked("target"), "plan", "where the light of a pilot landed, smoothed"},
		"unit":                 {nil, "bootstrap", "mean luminance of the first independent samples"},
		"blocks_per_segment":   {nil, "plan", "from the image size"},
		"round_sizes":          {nil, "plan", "growing rounds; from counts, never from time"},
		"worker_version":       {nil, "worker", "the version of the worker that inspected the scene"},
	}
}

// Choices lists the fields of a job's resolved spec by name; none before the spec is known.
func Choices(snapshot job.Snapshot) ([]Choice, error) {
	choices := []Choice{}
	if snapshot.Resolved == "" {
		return choices, nil
	}
	var fields map[string]json.RawMessage
	if err := json.Unmarshal([]byte(snapshot.Resolved), &fields); err != nil {
		return nil, fmt.Errorf("resolved spec of job %s: %w", snapshot.ID, err)
	}
	table := rules()
	for key, value := range fields {
		name := snakeCase(key)
		if name == "auto_decision" || name == "kernel_tuning" {
			continue // told apart from what decides the image
		}
		choices = append(choices, choose(table[name], name, plain(name, value), snapshot.Request))
	}
	slices.SortFunc(choices, func(a, b Choice) int { return strings.Compare(a.Name, b.Name) })
	return choices, nil
}

func choose(r rule, name, value string, request job.Request) Choice {
	switch {
	case request.Resolved != "":
		return Choice{name, value, "resolved", "repeated from an earlier job"}
	case r.asked != nil && r.asked(request):
		return Choice{name, value, "request", "asked for"}
	case r.source == "":
		return Choice{name, value, "plan", ""}
	default:
		return Choice{name, value, r.source, r.why}
	}
}

// plain turns a protobuf JSON value into words: no quotes, and enum values without their type.
func plain(name string, value json.RawMessage) string {
	if name == "target_map" {
		var m struct {
			Side int `json:"side"`
		}
		if json.Unmarshal(value, &m) == nil {
			return fmt.Sprintf("%d x %d cells", m.Side, m.Side)
		}
	}
	var text string
	if json.Unmarshal(value, &text) != nil {
		return string(value)
	}
	return strings.ToLower(strings.TrimPrefix(text, strings.ToUpper(name)+"_"))
}

func snakeCase(camel string) string {
	var b strings.Builder
	for _, r := range camel {
		if unicode.IsUpper(r) {
			b.WriteByte('_')
		}
		b.WriteRune(unicode.ToLower(r))
	}
	return b.String()
}
