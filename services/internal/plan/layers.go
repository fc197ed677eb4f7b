package plan

import (
	"slices"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/job"
)

// TechniqueImages is the number of images by technique: of paths with 0, 1, .. light vertices, the
// last with all that have more.
const TechniqueImages = 5

// setLayers decides what the film holds beside the image.
func setLayers(spec *jobv1.ResolvedSpec, r job.Request) (warning string) {
	if slices.Contains(r.Layers, job.LayerAcceptance) {
		spec.Layers = append(spec.Layers, jobv1.DiagnosticLayer_DIAGNOSTIC_LAYER_ACCEPTANCE)
	}
	switch {
	case !slices.Contains(r.Layers, job.LayerTechniques):
	case !Multiplexed(spec):
		return "layers leaves techniques out: " + IntegratorName(spec) + " does not take them one by one"
	default:
		spec.Layers = append(spec.Layers, jobv1.DiagnosticLayer_DIAGNOSTIC_LAYER_TECHNIQUES)
	}
	return ""
}

// imageLayers is the number of the film's layers that make the image.
func imageLayers(spec *jobv1.ResolvedSpec) int {
	switch {
	case !RunsChains(spec):
		return 1
	case DirectApart(spec):
		return 3
	}
	return 2
}

// AcceptanceLayer of the film; false: it has none.
func AcceptanceLayer(spec *jobv1.ResolvedSpec) (layer int, has bool) {
	return imageLayers(spec), slices.Contains(spec.GetLayers(), jobv1.DiagnosticLayer_DIAGNOSTIC_LAYER_ACCEPTANCE)
}

// TechniqueLayers of the film, the first of two for each image by technique; false: it has none.
func TechniqueLayers(spec *jobv1.ResolvedSpec) (first int, has bool) {
	first, acceptance := AcceptanceLayer(spec)
	if acceptance {
		first++
	}
	return first, slices.Contains(spec.GetLayers(), jobv1.DiagnosticLayer_DIAGNOSTIC_LAYER_TECHNIQUES)
}

// layers of the film.
func layers(spec *jobv1.ResolvedSpec) int {
	n, techniques := TechniqueLayers(spec)
	if techniques {
		n += 2 * TechniqueImages
	}
	return n
}

// checkLayers says what is wrong with the layers of a complete spec, "" if nothing is.
func checkLayers(s *jobv1.ResolvedSpec) string {
	for i, layer := range s.GetLayers() {
		switch {
		case !RunsChains(s):
			return "layers belong to chains"
		case layer < 1 || layer > 2:
			return "layers has one that is not known"
		case i > 0 && layer <= s.GetLayers()[i-1]:
			return "layers are not in ascending order"
		case layer == jobv1.DiagnosticLayer_DIAGNOSTIC_LAYER_TECHNIQUES && !Multiplexed(s):
			return "layers has techniques, which belong to INTEGRATOR_MMLT"
		}
	}
	return ""
}
