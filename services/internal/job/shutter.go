package job

import (
	"encoding/json"
	"fmt"
	"math"
	"strconv"
	"strings"
)

// Words of the shutter's options.
const (
	CurveBox       = "box"
	CurveTrapezoid = "trapezoid"

	ExposureNormalized = "normalized"
	ExposureCamera     = "camera"
)

// Numbers of efficiencies that a shutter curve may have.
const (
	minSamples = 2
	maxSamples = 1024
)

// ShutterCurve is a shutter's efficiency over the time from open to close: "", "box", "trapezoid", or at
// least two efficiencies at equal distances, with commas between. In JSON the latter are a list.
type ShutterCurve string

// Samples returns the efficiencies of a curve that gives them, nil of others. Errors are *FieldError.
func (c ShutterCurve) Samples() ([]float64, error) {
	if c == "" || c == CurveBox || c == CurveTrapezoid {
		return nil, nil
	}
	parts := strings.Split(string(c), ",")
	samples := make([]float64, len(parts))
	for i, part := range parts {
		var err error
		if samples[i], err = strconv.ParseFloat(strings.TrimSpace(part), 64); err != nil {
			return nil, invalid("shutter_curve", "is %q; allowed: %q, %q, or efficiencies such as 0, 0.5, 1, 0", string(c), CurveBox, CurveTrapezoid)
		}
	}
	if detail := CheckSamples(samples); detail != "" {
		return nil, invalid("shutter_curve", "%s", detail)
	}
	return samples, nil
}

// CheckSamples says what is wrong with the efficiencies of a shutter, "" if nothing is.
func CheckSamples(samples []float64) string {
	if len(samples) < minSamples || len(samples) > maxSamples {
		return fmt.Sprintf("has %d efficiencies, outside %d..%d", len(samples), minSamples, maxSamples)
	}
	dark := true
	for _, e := range samples {
		if !(e >= 0 && e < math.Inf(1)) {
			return fmt.Sprintf("has the efficiency %v; they are not negative, and finite", e)
		}
		dark = dark && e == 0
	}
	if dark {
		return "has no efficiency above 0: the image would be black"
	}
	return ""
}

// MarshalJSON implements json.Marshaler.
func (c ShutterCurve) MarshalJSON() ([]byte, error) {
	if samples, err := c.Samples(); err == nil && samples != nil {
		return json.Marshal(samples)
	}
	return json.Marshal(string(c))
}

// UnmarshalJSON implements json.Unmarshaler.
func (c *ShutterCurve) UnmarshalJSON(content []byte) error {
	var samples []float64
	if json.Unmarshal(content, &samples) != nil {
		return json.Unmarshal(content, (*string)(c))
	}
	texts := make([]string, len(samples))
	for i, e := range samples {
		texts[i] = strconv.FormatFloat(e, 'g', -1, 64)
	}
	*c = ShutterCurve(strings.Join(texts, ","))
	return nil
}

func shutterOptions() []Option {
	return []Option{
		{
			"shutter_open", "shutter-open", "SECONDS", nil, nil, "when the shutter opens, in the time of the scene's keyframes; default: the scene's",
			func(r *Request) any { return &r.ShutterOpen },
		},
		{
			"shutter_close", "shutter-close", "SECONDS", nil, nil, "when it closes; as it opens: an instant; default: the scene's",
			func(r *Request) any { return &r.ShutterClose },
		},
		{
			"shutter_curve", "shutter-curve", CurveBox + "|" + CurveTrapezoid + "|E,E,...", nil, nil,
			"how much light it lets through while open: all, with ramps, or efficiencies at equal distances; default box",
			func(r *Request) any { return &r.ShutterCurve },
		},
		{
			"shutter_ramp_open", "shutter-ramp-open", "SHARE", nil, nil,
			"of the trapezoid: share of the time in which the shutter opens; default 0",
			func(r *Request) any { return &r.ShutterRampOpen },
		},
		{
			"shutter_ramp_close", "shutter-ramp-close", "SHARE", nil, nil, "of the trapezoid: share of the time in which it closes; default 0",
			func(r *Request) any { return &r.ShutterRampClose },
		},
		{
			"exposure", "exposure", "",
			[]string{ExposureNormalized, ExposureCamera},
			nil, "normalized: the mean over the open time; camera: the integral, twice as long gives twice the light; default normalized",
			func(r *Request) any { return &r.Exposure },
		},
		{
			"rolling_shutter", "rolling-shutter", "SECONDS", nil, nil,
			"how much later the last row of pixels is exposed than the first, negative: earlier; default 0: all at once",
			func(r *Request) any { return &r.RollingShutter },
		},
	}
}

// checkShutter looks at what can be told without the scene, whose own shutter may stand in for a time
// that is not given.
func (r *Request) checkShutter() error {
	for _, c := range []struct {
		field string
		value float64
	}{
		{"shutter_open", valueOf(r.ShutterOpen)},
		{"shutter_close", valueOf(r.ShutterClose)},
		{"rolling_shutter", r.RollingShutter},
	} {
		if !(math.Abs(c.value) <= maxSeconds) {
			return invalid(c.field, "is %v, outside -%v..%v seconds", c.value, maxSeconds, maxSeconds)
		}
	}
	if r.ShutterOpen != nil && r.ShutterClose != nil {
		if err := r.CheckOpen(*r.ShutterOpen, *r.ShutterClose); err != nil {
			return err
		}
	}
	if _, err := r.ShutterCurve.Samples(); err != nil {
		return err
	}
	return r.checkRamps()
}

func valueOf(v *float64) float64 {
	if v == nil {
		return 0
	}
	return *v
}

// CheckOpen looks at the times between which the shutter is open, whoever gave them. Errors are
// *FieldError.
func (r *Request) CheckOpen(opens, closes float64) error {
	switch {
	case closes < opens && r.ShutterClose == nil:
		return invalid("shutter_open", "is %v, after the scene's shutter_close %v: give shutter_close, too", opens, closes)
	case closes < opens:
		return invalid("shutter_close", "is %v, before shutter_open %v", closes, opens)
	case r.Exposure == ExposureCamera && closes == opens:
		return invalid("exposure", "camera needs a shutter that is open for some time, but shutter_open and shutter_close are both %v", opens)
	}
	return nil
}

func (r *Request) checkRamps() error {
	for _, c := range []struct {
		field string
		ramp  float64
	}{{"shutter_ramp_open", r.ShutterRampOpen}, {"shutter_ramp_close", r.ShutterRampClose}} {
		switch {
		case c.ramp != 0 && r.ShutterCurve != CurveTrapezoid:
			return invalid(c.field, "belongs to shutter_curve trapezoid")
		case !(c.ramp >= 0 && c.ramp <= 1):
			return invalid(c.field, "is %v, outside 0..1", c.ramp)
		}
	}
	sum := r.ShutterRampOpen + r.ShutterRampClose
	switch {
	case sum > 1:
		return invalid("shutter_ramp_close", "and shutter_ramp_open sum to %v, more than the whole time", sum)
	case r.ShutterCurve == CurveTrapezoid && sum == 0:
		return invalid("shutter_ramp_open", "and shutter_ramp_close are both 0, which makes a box of the trapezoid: give one, or shutter_curve box")
	}
	return nil
}
