package explain

import (
	"fmt"
	"maps"
	"slices"
	"strings"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/plan"
)

// Feature is something that the renderer can do.
type Feature struct {
	// Name, for example "lens".
	Name string `json:"name"`
	// State is used or skipped.
	State string `json:"state" enum:"used,skipped"`
	// Evidence is the fact that decides.
	Evidence string `json:"evidence"`
}

const (
	used    = "used"
	skipped = "skipped"
)

// Features lists what a job uses and skips by the structure of its scene and its spec.
func Features(spec *jobv1.ResolvedSpec, scene *scenev1.SceneReport) []Feature {
	return slices.Concat(sampleFeatures(spec, scene), sceneFeatures(scene), techniqueFeatures(spec, scene), chainFeatures(spec))
}

// either is a feature that is used if a fact holds.
func either(name string, holds bool, ifUsed, ifSkipped string) Feature {
	if holds {
		return Feature{name, used, ifUsed}
	}
	return Feature{name, skipped, ifSkipped}
}

// sampleFeatures are the coordinates of a sample.
func sampleFeatures(spec *jobv1.ResolvedSpec, scene *scenev1.SceneReport) []Feature {
	lens := scene.GetStructure().GetLens()
	hasTime, evidence := plan.HasTime(spec, scene)
	return []Feature{
		either("time", hasTime, evidence, evidence),
		either("lens", lens, fmt.Sprintf("sensor %s with an aperture", scene.GetSensor()),
			fmt.Sprintf("sensor %s without an aperture: samples have no lens position", scene.GetSensor())),
	}
}

// sceneFeatures are what rays meet.
func sceneFeatures(scene *scenev1.SceneReport) []Feature {
	s := scene.GetStructure()
	return []Feature{
		either("textures", len(scene.GetTextures()) > 0, listed(scene.GetTextures()), "the scene has none"),
		either("instances", scene.GetInstances() > 0, number(scene.GetInstances(), "placement")+" of groups", "the scene has none: one level of acceleration"),
		either("alpha and mask choice", s.GetMaskedShapes() > 0,
			fmt.Sprintf("%d of %d shapes let rays through", s.GetMaskedShapes(), s.GetShapes()), "no material lets rays through"),
		either("environment tables", s.GetEnvironmentMaps() > 0,
			number(s.GetEnvironmentMaps(), "environment")+" made of an image", "no environment is an image"),
	}
}

// techniqueFeatures are the ways of making paths.
func techniqueFeatures(spec *jobv1.ResolvedSpec, scene *scenev1.SceneReport) []Feature {
	s := scene.GetStructure()
	both := plan.Bidirectional(spec)
	connectable := s.GetDeltaShapes() < s.GetShapes()
	bouncing := spec.GetMaxDepth() < 0 || spec.GetMaxDepth() > 1
	return []Feature{
		directFeature(s),
		hitFeature(spec, s),
		lightSamplingFeature(spec, s, connectable && bouncing),
		lightSubpathFeature(spec, s),
		cameraFeature(both, connectable && bouncing, s),
	}
}

func directFeature(s *scenev1.Structure) Feature {
	switch {
	case s.GetExtendedLights() == 0:
		return Feature{"lights seen directly", skipped, "no light that a ray can hit"}
	case s.GetHideEmitters():
		return Feature{"lights seen directly", skipped, "the scene hides its emitters"}
	}
	return Feature{"lights seen directly", used, number(s.GetExtendedLights(), "light") + " that a ray can hit"}
}

func hitFeature(spec *jobv1.ResolvedSpec, s *scenev1.Structure) Feature {
	const name = "lights hit by scattered rays"
	switch {
	case s.GetExtendedLights() == 0:
		return Feature{name, skipped, "no light that a ray can hit"}
	case spec.GetLightSampling() == jobv1.LightSampling_LIGHT_SAMPLING_EMITTER:
		return Feature{name, used, "only after scattering in one direction: light_sampling is emitter"}
	}
	return Feature{name, used, number(s.GetExtendedLights(), "light") + " that a ray can hit"}
}

func lightSamplingFeature(spec *jobv1.ResolvedSpec, s *scenev1.Structure, connectable bool) Feature {
	const name = "light sampling"
	lights := s.GetExtendedLights() + s.GetDeltaLights()
	switch {
	case lights == 0:
		return Feature{name, skipped, "the scene has no light"}
	case spec.GetLightSampling() == jobv1.LightSampling_LIGHT_SAMPLING_BSDF && s.GetDeltaLights() > 0:
		return Feature{name, skipped, "light_sampling is bsdf, which leaves out " + number(s.GetDeltaLights(), "light") + " without extent"}
	case spec.GetLightSampling() == jobv1.LightSampling_LIGHT_SAMPLING_BSDF:
		return Feature{name, skipped, "light_sampling is bsdf"}
	case !connectable:
		return Feature{name, skipped, noConnection(spec, s)}
	}
	return Feature{name, used, number(lights, "light")}
}

// noConnection says why no two vertices can be joined.
func noConnection(spec *jobv1.ResolvedSpec, s *scenev1.Structure) string {
	if spec.GetMaxDepth() == 1 {
		return "max_depth is 1: lights are only seen directly"
	}
	return fmt.Sprintf("all %d shapes scatter in fixed directions only", s.GetShapes())
}

func lightSubpathFeature(spec *jobv1.ResolvedSpec, s *scenev1.Structure) Feature {
	const name = "light subpaths"
	switch {
	case !plan.Bidirectional(spec):
		return Feature{name, skipped, plan.IntegratorName(spec) + " traces from the camera only"}
	case s.GetExtendedLights()+s.GetDeltaLights() == 0:
		return Feature{name, skipped, "the scene has no light"}
	}
	return Feature{name, used, fmt.Sprintf("%s, %d at infinity", number(s.GetExtendedLights()+s.GetDeltaLights(), "light"), s.GetDistantLights())}
}

func cameraFeature(both, connectable bool, s *scenev1.Structure) Feature {
	const name = "camera connections"
	switch {
	case !both:
		return Feature{name, skipped, "they need light subpaths"}
	case !connectable:
		return Feature{name, skipped, fmt.Sprintf("all %d shapes scatter in fixed directions only", s.GetShapes())}
	}
	return Feature{name, used, fmt.Sprintf("%d of %d shapes scatter in all directions", s.GetShapes()-s.GetDeltaShapes(), s.GetShapes())}
}

// chainFeatures are what chains do.
func chainFeatures(spec *jobv1.ResolvedSpec) []Feature {
	if !plan.RunsChains(spec) {
		reason := plan.IntegratorName(spec) + " takes independent samples"
		return []Feature{
			{"chains", skipped, reason},
			{"delayed rejection", skipped, reason},
			{"direct light apart", skipped, reason},
			{"equalized target", skipped, reason},
			{"subpath steps", skipped, reason},
		}
	}
	d := spec.GetDelayedRejection()
	features := []Feature{
		{"chains", used, fmt.Sprintf("%d chains over %s", plan.Chains(spec), overName(spec))},
		either("delayed rejection", d.GetEnabled(), word(d.GetAcceptanceRule().String(), "ACCEPTANCE_RULE_")+" acceptance", "not asked for"),
	}
	features = append(features, subpathFeature(spec),
		either("direct light apart", plan.DirectApart(spec), "chains carry paths of 3 edges and more", "not asked for, or nothing else is left to the chains"),
		either("equalized target", spec.GetTargetMap() != nil, fmt.Sprintf("luminance over a map of %d x %d cells", spec.GetTargetMap().GetSide(), spec.GetTargetMap().GetSide()), "the target is luminance"))
	if plan.Multiplexed(spec) {
		features = append(features, lengthFeature(spec))
	}
	return features
}

func subpathFeature(spec *jobv1.ResolvedSpec) Feature {
	const name = "subpath steps"
	k := spec.GetKernel()
	switch {
	case !plan.Bidirectional(spec):
		return Feature{name, skipped, "chains over path tracing have no light subpath"}
	case k.GetEyeStepProbability()+k.GetLightStepProbability() == 0:
		return Feature{name, skipped, "not asked for"}
	}
	return Feature{name, used, fmt.Sprintf("eye with probability %v, light with %v", k.GetEyeStepProbability(), k.GetLightStepProbability())}
}

func overName(spec *jobv1.ResolvedSpec) string {
	switch {
	case plan.Multiplexed(spec):
		return "single techniques of bidirectional path tracing"
	case plan.Bidirectional(spec):
		return "bidirectional path tracing"
	}
	return "path tracing"
}

// lengthFeature tells of path lengths that are left out.
func lengthFeature(spec *jobv1.ResolvedSpec) Feature {
	var none []string
	for k, p := range spec.GetLengthProbabilities() {
		if p == 0 {
			none = append(none, fmt.Sprint(k+1))
		}
	}
	if len(none) == 0 {
		return Feature{"path lengths", used, fmt.Sprintf("1 to %d edges", spec.GetMaxDepth())}
	}
	return Feature{"path lengths", used, fmt.Sprintf("1 to %d edges without %s, which cannot carry light", spec.GetMaxDepth(), strings.Join(none, ", "))}
}

func listed(counts map[string]uint32) string {
	var parts []string
	for _, kind := range slices.Sorted(maps.Keys(counts)) {
		parts = append(parts, fmt.Sprintf("%d %s", counts[kind], kind))
	}
	return strings.Join(parts, ", ")
}

// number is a count with its noun.
func number(n uint32, noun string) string {
	if n == 1 {
		return "1 " + noun
	}
	return fmt.Sprintf("%d %ss", n, noun)
}

func word(enum, prefix string) string {
	return strings.ReplaceAll(strings.ToLower(strings.TrimPrefix(enum, prefix)), "_", "-")
}
