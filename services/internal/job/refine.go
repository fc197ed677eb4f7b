package job

import (
	"fmt"
	"reflect"
	"strings"
)

// stopField begins the fields of stop rules, as options name them.
const stopField = "stop."

// StopOptions are the options that say when a job ends.
func StopOptions() []Option { return stopOptions() }

// Refined is the request with other stop rules, which go further than those before: what a job that has
// ended is to go on with. Errors are *FieldError. A job that was canceled may be asked for what it was
// asked for before.
func (r Request) Refined(stop StopRules, canceled bool) (Request, error) {
	if stop == (StopRules{}) {
		return Request{}, invalid("stop", "has no rule: say how far the job is to go")
	}
	before := r.Stop
	r.Stop = stop
	if err := r.Validate(); err != nil {
		return Request{}, err
	}
	if canceled {
		return r, nil
	}
	for _, c := range []struct {
		field         string
		asked, before float64
	}{
		{"samples_per_pixel", float64(stop.SamplesPerPixel), float64(before.SamplesPerPixel)},
		{"mutations_per_pixel", float64(stop.MutationsPerPixel), float64(before.MutationsPerPixel)},
		{"target_error", -stop.TargetError, -before.TargetError},
		{"time_seconds", stop.TimeSeconds, before.TimeSeconds},
		{"rounds", float64(stop.Rounds), float64(before.Rounds)},
	} {
		if c.asked != 0 && c.before != 0 && c.asked <= c.before {
			return Request{}, invalid(stopField+c.field, "asks for no more than the job was asked for before")
		}
	}
	return r, nil
}

// InBody is the error for a request whose body is the stop rules alone.
func (e *FieldError) InBody() *FieldError {
	return &FieldError{Field: strings.TrimPrefix(e.Field, stopField), Detail: e.Detail}
}

// String lists the rules that are given.
func (s StopRules) String() string {
	var rules []string
	r := Request{Stop: s}
	for _, o := range stopOptions() {
		if o.Set(&r) {
			value := reflect.ValueOf(o.In(&r)).Elem().Interface()
			rules = append(rules, fmt.Sprintf("%s %v", strings.TrimPrefix(o.Field, stopField), value))
		}
	}
	return strings.Join(rules, ", ")
}
