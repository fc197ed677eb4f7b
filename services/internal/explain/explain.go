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
	return map[string]rule{
		"integrator": {
			func(r job.Request) bool { return r.Integrator != "" && r.Integrator != job.IntegratorAuto },
			"plan", "chosen for the scene",
		},
		"light_sampling": {
			func(r job.Request) bool { return r.LightSampling != "" },
			"plan", "default: both ways of finding emitters, combined",
		},
		"max_depth": {func(r job.Request) bool { return r.MaxDepth != nil }, "scene", "the scene's setting"},
		"rr_depth":  {nil, "scene", "the scene's setting"},
		"width":     {func(r job.Request) bool { return r.Width != 0 }, "scene", "the scene's film"},
		"height":    {func(r job.Request) bool { return r.Height != 0 }, "scene", "the scene's film"},
		"seed":      {func(r job.Request) bool { return r.Seed != 0 }, "plan", "default"},
		"bootstrap_samples": {
			func(r job.Request) bool { return r.BootstrapSamples != 0 },
			"plan", "default",
		},
		"group_size":   {nil, "worker", "chains that the workers' build runs side by side"},
		"chain_groups": {func(r job.Request) bool { return r.Chains != 0 }, "plan", "default"},
		"kernel": {
			func(r job.Request) bool {
				return r.Kernel != "" || r.Sigma != 0 || r.LargeStepProbability != 0
			},
			"plan", "default",
		},
		"unit":               {nil, "bootstrap", "mean luminance of the first independent samples"},
		"blocks_per_segment": {nil, "plan", "from the image size"},
		"round_sizes":        {nil, "plan", "growing rounds; from counts, never from time"},
		"worker_version":     {nil, "worker", "the version of the worker that inspected the scene"},
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
