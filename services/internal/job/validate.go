package job

import (
	"fmt"
	"math"
	"path"
	"slices"
	"strings"
)

// Limits on requests, generous beside what a farm can render.
const (
	maxSide         = 32768
	maxNameBytes    = 200
	maxDefaults     = 1000
	maxDefaultBytes = 64 << 10 // names and values of all together
	maxBootstrap    = 1 << 24
	maxChains       = 1 << 20
	maxPerPixel     = 1 << 40
	maxRounds       = 64
	maxSeconds      = 1e9
	maxPriority     = 100 // and least, negative
)

// Validate checks everything that can be checked without the scene. Its errors are *FieldError.
func (r *Request) Validate() error {
	for _, check := range []func() error{
		r.validateScene, r.validateChoices, r.validateNumbers, r.checkShutter, r.checkChains, r.Stop.validate,
	} {
		if err := check(); err != nil {
			return err
		}
	}
	return nil
}

func (r *Request) validateScene() error {
	switch {
	case r.Scene == "":
		return invalid("scene", "is missing: the digest of a stored bundle")
	case r.Entry == "":
		return invalid("entry", "is missing: the scene file's path inside the bundle")
	case len(r.Defaults) > maxDefaults:
		return invalid("defaults", "has more than %d entries", maxDefaults)
	}
	bytes := 0
	for name, value := range r.Defaults {
		bytes += len(name) + len(value)
	}
	if bytes > maxDefaultBytes {
		return invalid("defaults", "has names and values of %d bytes; at most %d", bytes, maxDefaultBytes)
	}
	if err := validateName(r.Name); err != nil {
		return err
	}
	return validatePriority(r.Priority)
}

func validateName(name string) error {
	if len(name) > maxNameBytes {
		return invalid("name", "is longer than %d bytes", maxNameBytes)
	}
	return nil
}

func validatePriority(priority int) error {
	if priority < -maxPriority || priority > maxPriority {
		return invalid("priority", "is %d, outside -%d..%d", priority, maxPriority, maxPriority)
	}
	return nil
}

// SetDefaultName gives a request without a name that of its scene file.
func (r *Request) SetDefaultName() {
	if r.Name == "" {
		name := path.Base(r.Entry)
		r.Name = strings.ToValidUTF8(name[:min(len(name), maxNameBytes)], "")
	}
}

func (r *Request) validateChoices() error {
	for _, o := range Options() {
		if n := len(words(o.In(r))); len(o.Choices) > 0 && n > len(o.Choices) {
			return invalid(o.Field, "has %d words; there are no more than %d: %q", n, len(o.Choices), o.Choices)
		}
		for _, word := range words(o.In(r)) {
			if len(o.Choices) > 0 && !slices.Contains(o.Choices, word) {
				return invalid(o.Field, "is %q; allowed: %q", word, o.Choices)
			}
		}
	}
	if r.Integrator == "" || r.Integrator == IntegratorAuto {
		return nil
	}
	for _, o := range Options() {
		if o.Set(r) && !o.For(r.Integrator) {
			return invalid(o.Field, "belongs to %s; integrator is %s", strings.Join(o.Integrators, " and "), r.Integrator)
		}
	}
	if r.Under == IntegratorBDPT && r.LightSampling != "" {
		return invalid("light_sampling", "belongs to path tracing; under bdpt has every technique")
	}
	return nil
}

// words that a field gives.
func words(field any) []string {
	switch field := field.(type) {
	case *string:
		if *field != "" {
			return []string{*field}
		}
	case *[]string:
		return *field
	}
	return nil
}

func (r *Request) validateNumbers() error {
	switch {
	case r.Width < 0 || r.Width > maxSide:
		return invalid("width", "is %d, outside 1..%d", r.Width, maxSide)
	case r.Height < 0 || r.Height > maxSide:
		return invalid("height", "is %d, outside 1..%d", r.Height, maxSide)
	case r.BootstrapSamples > maxBootstrap:
		return invalid("bootstrap_samples", "is above %d", maxBootstrap)
	case r.MaxDepth != nil && *r.MaxDepth != -1 && (*r.MaxDepth < 1 || *r.MaxDepth > math.MaxInt32):
		return invalid("max_depth", "is %d; allowed: -1 (no limit) or at least 1", *r.MaxDepth)
	}
	return nil
}

func (s *StopRules) validate() error {
	switch {
	case s.SamplesPerPixel > maxPerPixel:
		return invalid("stop.samples_per_pixel", "is above %d", uint64(maxPerPixel))
	case s.MutationsPerPixel > maxPerPixel:
		return invalid("stop.mutations_per_pixel", "is above %d", uint64(maxPerPixel))
	case s.TargetError != 0 && !(s.TargetError > 0 && s.TargetError < math.Inf(1)):
		return invalid("stop.target_error", "is %v; a relative mean squared error is positive", s.TargetError)
	case s.TimeSeconds != 0 && !(s.TimeSeconds > 0 && s.TimeSeconds <= maxSeconds):
		return invalid("stop.time_seconds", "is %v, outside 0 < seconds <= %v", s.TimeSeconds, maxSeconds)
	case s.Rounds < 0 || s.Rounds > maxRounds:
		return invalid("stop.rounds", "is %d, outside 1..%d", s.Rounds, maxRounds)
	}
	return nil
}

func invalid(field, format string, args ...any) error {
	return &FieldError{Field: field, Detail: fmt.Sprintf(format, args...)}
}
