// Package plan turns a request and what a worker found in the scene into the resolved spec that
// decides the image. It is pure, and its choices depend on the request, the scene and pilot values
// only: never on time, threads or workers.
//
// Rules of the automatic choices:
//   - integrator auto is the scene's own where it is path or pssmlt, path otherwise;
//   - size, depth and roulette come from the scene unless the request overrides them;
//   - light sampling is mis; the kernel is kelemen with radii 1.9/1024 to 1.9/64, large steps 0.3;
//   - chain groups: one per 2048 pixels, rounded up to a multiple of 16, within 16..256;
//   - bootstrap: 4 samples per pixel within 65536..2^20, at least 32 per chain; the pilot of path
//     tracing has 16384;
//   - the film unit is b (pssmlt) or 256 times the pilot's mean luminance (path);
//   - rounds grow by 1.25 from one mutation per pixel, at least 16 per chain (pssmlt), or by 1.35
//     from 4 samples per pixel (path), and are cut so that they sum to the requested count.
package plan

import (
	"fmt"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

// GroupSize is the number of chains, or path samples, that a worker runs side by side.
const GroupSize = 64

const (
	groupMultiple   = 16 // chain groups come in multiples of the statistics groups
	maxGroups       = 256
	pixelsPerGroup  = 2048
	pilotSamples    = 16384
	minBootstrap    = 65536
	maxBootstrap    = 1 << 20
	bootstrapPerPix = 4
	seedsPerChain   = 32
	pathUnitFactor  = 256
	defaultSigma    = 0.01
	kelemenS1       = 1.9 / 1024
	kelemenS2       = 1.9 / 64
	largeStep       = 0.3
	maxPixels       = 1 << 26
)

// Resolve makes every choice but the film unit and the worker version, which SetUnit and the first
// lease add. Errors are *job.FieldError.
func Resolve(r job.Request, report *scenev1.SceneReport) (*jobv1.ResolvedSpec, []string, error) {
	if r.Resolved != "" {
		spec, err := ParseResolved(r.Resolved)
		return spec, nil, err
	}
	spec := &jobv1.ResolvedSpec{
		LightSampling: lightSampling(r.LightSampling),
		MaxDepth:      report.GetMaxDepth(),
		RrDepth:       max(1, report.GetRrDepth()),
		Width:         override(report.GetWidth(), r.Width),
		Height:        override(report.GetHeight(), r.Height),
		Seed:          r.Seed,
		GroupSize:     GroupSize,
	}
	if r.MaxDepth != nil {
		spec.MaxDepth = int32(*r.MaxDepth)
	}
	shape := film.Shape{Width: int(spec.Width), Height: int(spec.Height), Layers: 1}
	if err := shape.Validate(); err != nil {
		return nil, nil, &job.FieldError{Field: "width", Detail: err.Error()}
	}
	if spec.Width*spec.Height > maxPixels {
		return nil, nil, &job.FieldError{Field: "width", Detail: fmt.Sprintf("%d x %d has more than %d pixels", spec.Width, spec.Height, maxPixels)}
	}
	warnings := chooseIntegrator(spec, r, report)
	if spec.Integrator == jobv1.Integrator_INTEGRATOR_PSSMLT {
		resolvePSSMLT(spec, r)
	} else {
		resolvePath(spec, r, report)
	}
	spec.RoundSizes = roundSizes(spec, requestedCount(spec, r, report))
	return spec, warnings, nil
}

func chooseIntegrator(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) []string {
	name, warnings := r.Integrator, []string(nil)
	if name == "" || name == job.IntegratorAuto {
		name = report.GetIntegrator()
		if name != job.IntegratorPath && name != job.IntegratorPSSMLT {
			warnings = append(warnings, fmt.Sprintf("the scene's integrator %q is not available; path is used", name))
			name = job.IntegratorPath
		}
	}
	spec.Integrator = jobv1.Integrator_INTEGRATOR_PATH
	if name == job.IntegratorPSSMLT {
		spec.Integrator = jobv1.Integrator_INTEGRATOR_PSSMLT
	}
	return warnings
}

func resolvePSSMLT(spec *jobv1.ResolvedSpec, r job.Request) {
	pixels := uint64(spec.Width) * uint64(spec.Height)
	groups := uint64(roundUp((pixels+pixelsPerGroup-1)/pixelsPerGroup, groupMultiple))
	groups = min(max(groups, groupMultiple), maxGroups)
	if r.Chains > 0 {
		groups = roundUp((r.Chains+GroupSize-1)/GroupSize, groupMultiple)
	}
	spec.ChainGroups = uint32(groups)
	samples := min(max(bootstrapPerPix*pixels, minBootstrap), maxBootstrap)
	samples = max(samples, seedsPerChain*groups*GroupSize)
	if r.BootstrapSamples > 0 {
		samples = r.BootstrapSamples
	}
	spec.BootstrapSamples = roundUp(samples, film.Halves*GroupSize)
	spec.Kernel = kernel(r)
}

func resolvePath(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) {
	samples := uint64(pilotSamples)
	if r.BootstrapSamples > 0 {
		samples = r.BootstrapSamples
	}
	spec.BootstrapSamples = roundUp(samples, film.Halves*GroupSize)
	blocks := (Cells(spec, report) + GroupSize - 1) / GroupSize
	spec.BlocksPerSegment = uint32(min(max(1, (blocks+targetSegments-1)/targetSegments), maxBlocksPerSegment))
}

func kernel(r job.Request) *jobv1.Kernel {
	k := &jobv1.Kernel{
		Kind: jobv1.KernelKind_KERNEL_KIND_KELEMEN_PAIR, S1: kelemenS1, S2: kelemenS2,
		LargeStepProbability: largeStep,
	}
	if r.Kernel == "gaussian" {
		k = &jobv1.Kernel{
			Kind: jobv1.KernelKind_KERNEL_KIND_GAUSSIAN, Sigma: defaultSigma, LargeStepProbability: largeStep,
		}
	}
	if r.Sigma > 0 {
		k.Sigma = r.Sigma
	}
	if r.LargeStepProbability > 0 {
		k.LargeStepProbability = r.LargeStepProbability
	}
	return k
}

// SetUnit fixes the film unit from the mean luminance of the bootstrap or pilot, unless the spec
// has one already (a repeated job). It reports black when a PSSMLT job has nothing to render.
func SetUnit(spec *jobv1.ResolvedSpec, mean float64) (warning string, black bool) {
	pssmlt := spec.GetIntegrator() == jobv1.Integrator_INTEGRATOR_PSSMLT
	switch {
	case !(mean > 0) && pssmlt:
		warning, black = "no bootstrap sample carries light: the image is black", true
		mean = 1
	case !(mean > 0):
		warning = "no pilot sample carries light: the film unit is 1"
		mean = 1
	case !pssmlt:
		mean *= pathUnitFactor
	}
	if spec.GetUnit() == 0 {
		spec.Unit = mean
	}
	return warning, black
}

func lightSampling(name string) jobv1.LightSampling {
	switch name {
	case "emitter":
		return jobv1.LightSampling_LIGHT_SAMPLING_EMITTER
	case "bsdf":
		return jobv1.LightSampling_LIGHT_SAMPLING_BSDF
	}
	return jobv1.LightSampling_LIGHT_SAMPLING_MIS
}

func override(scene uint32, requested int) uint32 {
	if requested > 0 {
		return uint32(requested)
	}
	return scene
}

func roundUp(n, multiple uint64) uint64 { return (n + multiple - 1) / multiple * multiple }
