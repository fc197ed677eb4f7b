package plan

import (
	"fmt"
	"math"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
)

// setShutter copies what the request says of the shutter; what it does not say is the scene's. Errors are
// *job.FieldError.
func setShutter(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) error {
	samples, err := r.ShutterCurve.Samples()
	if err != nil {
		return err
	}
	spec.ShutterOpen, spec.ShutterClose = r.ShutterOpen, r.ShutterClose
	spec.ShutterSamples = samples
	spec.ShutterRampOpen, spec.ShutterRampClose = r.ShutterRampOpen, r.ShutterRampClose
	spec.RollingShutter = r.RollingShutter
	switch {
	case samples != nil:
		spec.ShutterCurve = jobv1.ShutterCurve_SHUTTER_CURVE_TABULATED
	case r.ShutterCurve == job.CurveTrapezoid:
		spec.ShutterCurve = jobv1.ShutterCurve_SHUTTER_CURVE_TRAPEZOID
	case r.ShutterCurve == job.CurveBox:
		spec.ShutterCurve = jobv1.ShutterCurve_SHUTTER_CURVE_BOX
	}
	spec.Exposure = map[string]jobv1.Exposure{
		job.ExposureNormalized: jobv1.Exposure_EXPOSURE_NORMALIZED,
		job.ExposureCamera:     jobv1.Exposure_EXPOSURE_CAMERA,
	}[r.Exposure]
	opens, closes := Shutter(spec, report)
	return r.CheckOpen(opens, closes)
}

// Shutter returns when the shutter opens and closes, in seconds.
func Shutter(spec *jobv1.ResolvedSpec, scene *scenev1.SceneReport) (opens, closes float64) {
	opens, closes = scene.GetShutterOpen(), scene.GetShutterClose()
	if spec.ShutterOpen != nil {
		opens = spec.GetShutterOpen()
	}
	if spec.ShutterClose != nil {
		closes = spec.GetShutterClose()
	}
	return opens, closes
}

// HasTime tells whether the samples of a job have a time, and why.
func HasTime(spec *jobv1.ResolvedSpec, scene *scenev1.SceneReport) (has bool, evidence string) {
	spans := scene.GetStructure().GetMoving()
	if len(spans) == 0 {
		return false, "nothing moves: samples have no time"
	}
	opens, closes := Shutter(spec, scene)
	first, last := opens+min(0, spec.GetRollingShutter()), closes+max(0, spec.GetRollingShutter())
	if !(last > first) {
		return false, fmt.Sprintf("the shutter opens for an instant, at %g s: samples have no time", opens)
	}
	for _, span := range spans {
		if span.GetBegin() < last && span.GetEnd() > first {
			return true, fmt.Sprintf("the shutter is open from %g to %g s%s, and something moves from %g to %g s",
				opens, closes, rolls(spec), span.GetBegin(), span.GetEnd())
		}
	}
	return false, fmt.Sprintf("nothing moves while the shutter is open, from %g to %g s%s: samples have no time", opens, closes, rolls(spec))
}

// rolls says how the shutter rolls, if it does.
func rolls(spec *jobv1.ResolvedSpec) string {
	if spec.GetRollingShutter() == 0 {
		return ""
	}
	return fmt.Sprintf(" (the last row %g s later)", spec.GetRollingShutter())
}

// checkShutter says what is wrong with the shutter of a complete spec, "" if nothing is.
func checkShutter(s *jobv1.ResolvedSpec) string {
	tabulated := s.GetShutterCurve() == jobv1.ShutterCurve_SHUTTER_CURVE_TABULATED
	trapezoid := s.GetShutterCurve() == jobv1.ShutterCurve_SHUTTER_CURVE_TRAPEZOID
	opens, closes := s.GetShutterRampOpen(), s.GetShutterRampClose()
	switch {
	case !finite(s.GetShutterOpen()) || !finite(s.GetShutterClose()) || !finite(s.GetRollingShutter()):
		return "shutter_open, shutter_close or rolling_shutter is not finite"
	case s.ShutterOpen != nil && s.ShutterClose != nil && s.GetShutterClose() < s.GetShutterOpen():
		return "shutter_close is before shutter_open"
	case s.GetShutterCurve() < 0 || s.GetShutterCurve() > jobv1.ShutterCurve_SHUTTER_CURVE_TABULATED:
		return "shutter_curve is unknown"
	case !tabulated && len(s.GetShutterSamples()) > 0:
		return "shutter_samples belong to SHUTTER_CURVE_TABULATED"
	case !trapezoid && (opens != 0 || closes != 0):
		return "shutter_ramp_open and shutter_ramp_close belong to SHUTTER_CURVE_TRAPEZOID"
	case !(opens >= 0 && closes >= 0 && opens+closes <= 1):
		return "shutter_ramp_open or shutter_ramp_close is negative, or they sum to more than 1"
	case s.GetExposure() < 0 || s.GetExposure() > jobv1.Exposure_EXPOSURE_CAMERA:
		return "exposure is unknown"
	case s.GetExposure() == jobv1.Exposure_EXPOSURE_CAMERA && s.ShutterOpen != nil && s.ShutterClose != nil && s.GetShutterClose() == s.GetShutterOpen():
		return "exposure EXPOSURE_CAMERA needs shutter_close later than shutter_open"
	}
	if tabulated {
		if detail := job.CheckSamples(s.GetShutterSamples()); detail != "" {
			return "shutter_samples " + detail
		}
	}
	return ""
}

func finite(x float64) bool { return !math.IsNaN(x) && !math.IsInf(x, 0) }
