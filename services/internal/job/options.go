package job

import (
	"reflect"
	"slices"
	"strings"
)

// Option is one field that a request may leave out. The command line's flags, their help and the
// interface description are made of this table.
type Option = OptionOf[Request]

// OptionOf is an option of a document of type T.
type OptionOf[T any] struct {
	// Field as in the JSON document, for example "stop.time_seconds".
	Field string
	// Flag of the command line, without its dashes.
	Flag string
	// Value names what the flag takes; empty for a choice or a switch.
	Value string
	// Choices are the words allowed; none where it is no choice.
	Choices []string
	// Integrators that it has a meaning for; none: all of them.
	Integrators []string
	// Text says what it does.
	Text string
	// In returns the address of the field: a *string, *float64, *uint64, *int, *bool, **int, **float64,
	// *ShutterCurve, *[]string (any number of the choices) or *map[string]string.
	In func(*T) any
}

// Groups of integrators that options belong to.
var (
	plain          = []string{IntegratorPath, IntegratorBDPT}
	chains         = []string{IntegratorPSSMLT, IntegratorMMLT}
	unidirectional = []string{IntegratorPath, IntegratorPSSMLT}
)

// Options lists all of them, the way help does.
func Options() []Option {
	return slices.Concat(mainOptions(), shutterOptions(), chainOptions(), stopOptions())
}

func mainOptions() []Option {
	return []Option{
		{
			"name", "name", "NAME", nil, nil, "name of the job; default: the scene file's, with its folder",
			func(r *Request) any { return &r.Name },
		},
		{
			"integrator", "integrator", "",
			[]string{IntegratorAuto, IntegratorPath, IntegratorBDPT, IntegratorPSSMLT, IntegratorMMLT},
			nil, "what produces the samples; default auto: decided by a pilot's counts",
			func(r *Request) any { return &r.Integrator },
		},
		{
			"under", "under", "",
			[]string{IntegratorPath, IntegratorBDPT},
			[]string{IntegratorPSSMLT},
			"what the chains run over; default path", func(r *Request) any { return &r.Under },
		},
		{
			"light_sampling", "light-sampling", "",
			[]string{"mis", "emitter", "bsdf"},
			unidirectional,
			"how path tracing finds emitters; default mis: both ways, weighted",
			func(r *Request) any { return &r.LightSampling },
		},
		{
			"max_depth", "max-depth", "N", nil, nil,
			"longest path in edges; -1: no limit (mmlt: 32); default: the scene's",
			func(r *Request) any { return &r.MaxDepth },
		},
		{"seed", "seed", "N", nil, nil, "another seed, another noise", func(r *Request) any { return &r.Seed }},
		{
			"width", "width", "PIXELS", nil, nil, "image width; default: the scene's",
			func(r *Request) any { return &r.Width },
		},
		{
			"height", "height", "PIXELS", nil, nil, "image height; default: the scene's",
			func(r *Request) any { return &r.Height },
		},
		{
			"defaults", "set", "NAME=VALUE", nil, nil, "value of a <default> of the scene; may be repeated",
			func(r *Request) any { return &r.Defaults },
		},
		{
			"lenient", "lenient", "", nil, nil, "warn about what is not known in the scene instead of refusing it",
			func(r *Request) any { return &r.Lenient },
		},
		{
			"bootstrap_samples", "bootstrap", "N", nil, nil, "at least so many independent samples first",
			func(r *Request) any { return &r.BootstrapSamples },
		},
	}
}

func stopOptions() []Option {
	return []Option{
		{
			"stop.samples_per_pixel", "spp", "N", nil, plain, "stop after so many samples per pixel",
			func(r *Request) any { return &r.Stop.SamplesPerPixel },
		},
		{
			"stop.mutations_per_pixel", "mutations-per-pixel", "N", nil, chains, "stop after so many mutations per pixel",
			func(r *Request) any { return &r.Stop.MutationsPerPixel },
		},
		{
			"stop.time_seconds", "time", "SECONDS", nil, nil, "stop after so many seconds of rendering, at the end of a round",
			func(r *Request) any { return &r.Stop.TimeSeconds },
		},
		{
			"stop.target_error", "target-error", "RELMSE", nil, nil, "stop when the relative MSE is below it",
			func(r *Request) any { return &r.Stop.TargetError },
		},
		{
			"stop.rounds", "rounds", "N", nil, nil, "stop after exactly so many rounds",
			func(r *Request) any { return &r.Stop.Rounds },
		},
	}
}

// Set tells whether a request gives the option.
func (o OptionOf[T]) Set(r *T) bool { return !reflect.ValueOf(o.In(r)).Elem().IsZero() }

// For tells whether the option has a meaning for an integrator.
func (o OptionOf[T]) For(integrator string) bool {
	return len(o.Integrators) == 0 || slices.Contains(o.Integrators, integrator)
}

// Takes says what follows the flag: a word for a value, the choices, or "" for a switch.
func (o OptionOf[T]) Takes() string {
	if len(o.Choices) > 0 {
		return strings.Join(o.Choices, "|")
	}
	return o.Value
}

// Help is the text with the integrators that it belongs to.
func (o OptionOf[T]) Help() string {
	if len(o.Integrators) == 0 {
		return o.Text
	}
	return o.Text + " (" + strings.Join(o.Integrators, ", ") + ")"
}

// Ignored lists the fields that a request gives and an integrator has no use for.
func (r *Request) Ignored(integrator string) []string {
	var fields []string
	for _, o := range Options() {
		if !strings.HasPrefix(o.Field, "stop.") && o.Set(r) && !o.For(integrator) {
			fields = append(fields, o.Field)
		}
	}
	return fields
}
