package plan

import (
	"errors"
	"math"
	"slices"
	"strings"
	"testing"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// moving is a scene in which something moves in these spans, with a shutter of its own.
func moving(opens, closes float64, spans ...*scenev1.TimeSpan) *scenev1.SceneReport {
	s := scene(64, 64, "path")
	s.ShutterOpen, s.ShutterClose = opens, closes
	s.Structure = &scenev1.Structure{Motion: len(spans) > 0, Moving: spans}
	return s
}

func at(seconds float64) *float64 { return &seconds }

func TestShutterOfTheSpec(t *testing.T) {
	request := job.Request{
		ShutterOpen: at(0), ShutterClose: at(0.5), ShutterCurve: job.CurveTrapezoid, ShutterRampOpen: 0.25,
		ShutterRampClose: 0.5, Exposure: job.ExposureCamera, RollingShutter: -0.125,
	}
	for _, integrator := range []string{"path", "pssmlt", "auto"} {
		request.Integrator = integrator
		spec, err := Pilot(request, moving(1, 2))
		if integrator != "auto" {
			spec, _, err = Resolve(request, moving(1, 2))
		}
		if err != nil {
			t.Fatal(err)
		}
		if spec.ShutterOpen == nil || spec.GetShutterOpen() != 0 || spec.GetShutterClose() != 0.5 ||
			spec.GetShutterCurve() != jobv1.ShutterCurve_SHUTTER_CURVE_TRAPEZOID || spec.GetShutterRampOpen() != 0.25 ||
			spec.GetShutterRampClose() != 0.5 || spec.GetExposure() != jobv1.Exposure_EXPOSURE_CAMERA || spec.GetRollingShutter() != -0.125 {
			t.Errorf("%s: %v", integrator, spec)
		}
	}
	spec := resolve(t, job.Request{Integrator: "path", ShutterCurve: "0, 1,0.5"}, moving(1, 2))
	if spec.GetShutterCurve() != jobv1.ShutterCurve_SHUTTER_CURVE_TABULATED || !slices.Equal(spec.GetShutterSamples(), []float64{0, 1, 0.5}) {
		t.Errorf("curve %v of %v", spec.GetShutterCurve(), spec.GetShutterSamples())
	}
	if spec.ShutterOpen != nil || spec.ShutterClose != nil || spec.GetExposure() != 0 {
		t.Errorf("what was not asked for: %v", spec)
	}
	spec.Unit = 1
	text, err := FormatResolved(spec)
	if err != nil {
		t.Fatal(err)
	}
	if again, err := ParseResolved(text); err != nil || !slices.Equal(again.GetShutterSamples(), spec.GetShutterSamples()) {
		t.Errorf("%v, error %v", again, err)
	}
}

func TestTheScenesShutterStandsInForWhatIsNotGiven(t *testing.T) {
	for name, c := range map[string]struct {
		request job.Request
		field   string
	}{
		"opens too late":   {job.Request{ShutterOpen: at(3)}, "shutter_open"},
		"closes too early": {job.Request{ShutterClose: at(0.5)}, "shutter_close"},
		"an instant":       {job.Request{ShutterOpen: at(2), Exposure: job.ExposureCamera}, "exposure"},
	} {
		_, _, err := Resolve(c.request, moving(1, 2))
		var wrong *job.FieldError
		if !errors.As(err, &wrong) || wrong.Field != c.field {
			t.Errorf("%s: %v", name, err)
		}
	}
	if opens, closes := Shutter(resolve(t, job.Request{ShutterOpen: at(1.5)}, moving(1, 2)), moving(1, 2)); opens != 1.5 || closes != 2 {
		t.Errorf("open from %v to %v", opens, closes)
	}
}

func TestTimeIsThereWhereSomethingMovesWhileTheShutterIsOpen(t *testing.T) {
	early, late := &scenev1.TimeSpan{Begin: 0, End: 1}, &scenev1.TimeSpan{Begin: 2, End: 3}
	for _, c := range []struct {
		scene         *scenev1.SceneReport
		opens, closes float64
		rolling       float64
		has           bool
		says          string
	}{
		{moving(0, 0), 0, 1, 0, false, "nothing moves: "},
		{moving(0, 0, early), 0.5, 0.5, 0, false, "instant, at 0.5 s"},
		{moving(0, 0, early), 0.5, 0.5, 0.1, true, "the last row 0.1 s later"},
		{moving(0, 0, early, late), 1, 2, 0, false, "while the shutter is open, from 1 to 2 s"},
		{moving(0, 0, early, late), 1, 2, 0.5, true, "from 2 to 3 s"},
		{moving(0, 0, early, late), 1, 2, -0.5, true, "from 0 to 1 s"},
		{moving(0, 0, early, late), -1, 0.25, 0, true, "from 0 to 1 s"},
		{moving(0, 0, early, late), 3, 4, 0, false, "from 3 to 4 s"},
	} {
		spec := &jobv1.ResolvedSpec{ShutterOpen: &c.opens, ShutterClose: &c.closes, RollingShutter: c.rolling}
		if has, evidence := HasTime(spec, c.scene); has != c.has || !strings.Contains(evidence, c.says) {
			t.Errorf("%+v: %v, %q", c, has, evidence)
		}
	}
}

func TestSpecsWithABadShutterAreRefused(t *testing.T) {
	good := resolve(t, job.Request{Integrator: "path"}, moving(1, 2))
	good.Unit = 1
	if detail := checkSpec(good); detail != "" {
		t.Fatal(detail)
	}
	trapezoid, tabulated := jobv1.ShutterCurve_SHUTTER_CURVE_TRAPEZOID, jobv1.ShutterCurve_SHUTTER_CURVE_TABULATED
	for says, change := range map[string]func(*jobv1.ResolvedSpec){
		"not finite":          func(s *jobv1.ResolvedSpec) { s.RollingShutter = math.Inf(1) },
		"before shutter_open": func(s *jobv1.ResolvedSpec) { s.ShutterOpen, s.ShutterClose = at(1), at(0) },
		"curve is unknown":    func(s *jobv1.ResolvedSpec) { s.ShutterCurve = 4 },
		"samples belong":      func(s *jobv1.ResolvedSpec) { s.ShutterSamples = []float64{1, 1} },
		"ramp_close belong":   func(s *jobv1.ResolvedSpec) { s.ShutterRampOpen = 0.5 },
		"sum to more": func(s *jobv1.ResolvedSpec) {
			s.ShutterCurve, s.ShutterRampOpen, s.ShutterRampClose = trapezoid, 0.75, 0.5
		},
		"exposure is unknown":    func(s *jobv1.ResolvedSpec) { s.Exposure = 3 },
		"later than":             func(s *jobv1.ResolvedSpec) { s.Exposure, s.ShutterOpen, s.ShutterClose = 2, at(1), at(1) },
		"0 efficiencies":         func(s *jobv1.ResolvedSpec) { s.ShutterCurve = tabulated },
		"no efficiency above 0":  func(s *jobv1.ResolvedSpec) { s.ShutterCurve, s.ShutterSamples = tabulated, []float64{0, 0} },
		"not negative, and fini": func(s *jobv1.ResolvedSpec) { s.ShutterCurve, s.ShutterSamples = tabulated, []float64{1, -1} },
	} {
		spec := resolve(t, job.Request{Integrator: "path"}, moving(1, 2))
		spec.Unit = 1
		change(spec)
		if detail := checkSpec(spec); !strings.Contains(detail, says) {
			t.Errorf("%q, want %q", detail, says)
		}
	}
}
