package job

import (
	"encoding/json"
	"errors"
	"math"
	"strings"
	"testing"
)

func at(seconds float64) *float64 { return &seconds }

func TestShutterRefusalsNameTheField(t *testing.T) {
	for name, c := range map[string]struct {
		request Request
		field   string
		says    string
	}{
		"order":           {Request{ShutterOpen: at(1), ShutterClose: at(0.5)}, "shutter_close", "before shutter_open 1"},
		"open":            {Request{ShutterOpen: at(math.NaN())}, "shutter_open", "seconds"},
		"close":           {Request{ShutterClose: at(math.Inf(1))}, "shutter_close", "seconds"},
		"rolling":         {Request{RollingShutter: -2e9}, "rolling_shutter", "seconds"},
		"curve":           {Request{ShutterCurve: "gauss"}, "shutter_curve", "trapezoid"},
		"one efficiency":  {Request{ShutterCurve: "1"}, "shutter_curve", "2..1024"},
		"many":            {Request{ShutterCurve: ShutterCurve(strings.Repeat("1,", 1024) + "1")}, "shutter_curve", "1025"},
		"negative":        {Request{ShutterCurve: "0,1,-0.5"}, "shutter_curve", "-0.5"},
		"endless":         {Request{ShutterCurve: "0,Inf"}, "shutter_curve", "finite"},
		"no number":       {Request{ShutterCurve: "0,x"}, "shutter_curve", "efficiencies"},
		"closed":          {Request{ShutterCurve: "0,0,0"}, "shutter_curve", "black"},
		"ramp of a box":   {Request{ShutterRampOpen: 0.5}, "shutter_ramp_open", "trapezoid"},
		"ramp of a table": {Request{ShutterCurve: "0,1", ShutterRampClose: 0.5}, "shutter_ramp_close", "trapezoid"},
		"negative ramp":   {Request{ShutterCurve: CurveTrapezoid, ShutterRampClose: -0.5}, "shutter_ramp_close", "0..1"},
		"ramps":           {Request{ShutterCurve: CurveTrapezoid, ShutterRampOpen: 0.75, ShutterRampClose: 0.5}, "shutter_ramp_close", "1.25"},
		"no ramps":        {Request{ShutterCurve: CurveTrapezoid}, "shutter_ramp_open", "both 0"},
		"exposure":        {Request{Exposure: "long"}, "exposure", "camera"},
		"instant":         {Request{Exposure: ExposureCamera, ShutterOpen: at(2), ShutterClose: at(2)}, "exposure", "both 2"},
	} {
		c.request.Scene, c.request.Entry = "aa", "scene.xml"
		var wrong *FieldError
		if err := c.request.Validate(); !errors.As(err, &wrong) || wrong.Field != c.field || !strings.Contains(wrong.Detail, c.says) {
			t.Errorf("%s: %v", name, err)
		}
	}
}

func TestGoodShutters(t *testing.T) {
	for _, r := range []Request{
		{ShutterOpen: at(-1), ShutterClose: at(-1)},
		{ShutterClose: at(0.5), Exposure: ExposureCamera},
		{ShutterOpen: at(0), ShutterClose: at(0.5), ShutterCurve: CurveTrapezoid, ShutterRampOpen: 0.25, ShutterRampClose: 0.75},
		{ShutterCurve: "0, 0.5 ,1,0", RollingShutter: -0.01},
		{ShutterCurve: CurveBox, Exposure: ExposureNormalized},
	} {
		r.Scene, r.Entry = "aa", "scene.xml"
		if err := r.Validate(); err != nil {
			t.Errorf("%+v: %v", r, err)
		}
	}
}

func TestShutterCurveInJSON(t *testing.T) {
	for content, want := range map[string]ShutterCurve{
		`"box"`: CurveBox, `"trapezoid"`: CurveTrapezoid, `""`: "", `[0,0.25,1]`: "0,0.25,1", `[]`: "", `"wrong"`: "wrong",
	} {
		var got ShutterCurve
		if err := json.Unmarshal([]byte(content), &got); err != nil || got != want {
			t.Errorf("%s became %q, error %v", content, got, err)
		}
		if again, err := json.Marshal(got); err != nil || string(again) != content && content != "[]" {
			t.Errorf("%s became %s, error %v", content, again, err)
		}
	}
	var c ShutterCurve
	for _, content := range []string{`3`, `{"a":1}`, `["a"]`} {
		if err := json.Unmarshal([]byte(content), &c); err == nil {
			t.Errorf("%s became %q", content, c)
		}
	}
	if text, err := json.Marshal(Request{ShutterCurve: "0, 1", ShutterOpen: at(0)}); err != nil || !strings.Contains(string(text), `"shutter_open":0,"shutter_curve":[0,1]`) {
		t.Errorf("%s, error %v", text, err)
	}
}
