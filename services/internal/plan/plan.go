// Package plan turns a request and what a worker found in the scene into the resolved spec that
// decides the image. It is pure, and its choices depend on the request, the scene and pilot values
// only: never on time, threads or workers.
//
// Rules of the automatic choices:
//   - integrator auto is the scene's own where that is bdpt, pssmlt or mmlt; else a pilot decides,
//     see auto.go;
//   - size, depth, roulette and shutter come from the scene unless the request overrides them; mmlt
//     takes paths of up to 32 edges;
//   - light sampling is mis, chains run over path tracing; the kernel is kelemen with radii 1.9/1024
//     to 1.9/64, large steps 0.3; no second stage; two-layer weights; techniques are frozen;
//   - chain groups: one per 2048 pixels, rounded up to a multiple of 16, within 16..256;
//   - bootstrap: 4 samples per pixel within 65536..2^20, at least 32 per chain; the pilot of
//     independent samples has 16384; mmlt rounds up so that each length has equally many;
//   - the film unit is b (chains) or 256 times the pilot's mean luminance (path, bdpt);
//   - rounds grow by 1.25 from one mutation per pixel, at least 16 per chain (chains), or by 1.35
//     from 4 samples per pixel (path, bdpt), and are cut so that they sum to the requested count;
//     chains that are cut make a multiple of 16 mutations each.
package plan

import (
	"fmt"
	"strings"

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
	// LongestMultiplexed is the number of edges of the longest path of mmlt.
	LongestMultiplexed = 32
	maxPixels          = 1 << 26
)

// Resolve makes every choice but the film unit, the path lengths' probabilities and the worker
// version, which SetUnit, SetLengths and the first lease add. Requires: not NeedsPilot. Errors are
// *job.FieldError.
func Resolve(r job.Request, report *scenev1.SceneReport) (*jobv1.ResolvedSpec, []string, error) {
	if r.Resolved != "" {
		spec, err := ParseResolved(r.Resolved)
		return spec, nil, err
	}
	spec := &jobv1.ResolvedSpec{
		Integrator:    integrator(chosen(r, report)),
		LightSampling: lightSampling(r.LightSampling),
		MaxDepth:      report.GetMaxDepth(),
		RrDepth:       max(1, report.GetRrDepth()),
		Width:         override(report.GetWidth(), r.Width),
		Height:        override(report.GetHeight(), r.Height),
		Seed:          r.Seed,
		GroupSize:     GroupSize,
	}
	if err := checkSize(spec); err != nil {
		return nil, nil, err
	}
	if err := setShutter(spec, r, report); err != nil {
		return nil, nil, err
	}
	var warnings []string
	if ignored := r.Ignored(IntegratorName(spec)); len(ignored) > 0 {
		warnings = append(warnings, fmt.Sprintf("%s has no use for %s", IntegratorName(spec), strings.Join(ignored, ", ")))
	}
	if RunsChains(spec) {
		setChains(spec, r)
	}
	depthWarnings, err := setDepth(spec, r)
	if err != nil {
		return nil, nil, err
	}
	if RunsChains(spec) {
		setSeeds(spec, r)
	} else {
		setSegments(spec, r, report)
	}
	spec.RoundSizes = roundSizes(spec, requestedCount(spec, r, report))
	warnings = append(warnings, depthWarnings...)
	if RunsChains(spec) {
		apart, warning := wantsDirectApart(spec, r)
		if apart {
			spec.DirectSizes = directSizes(spec)
		}
		for _, text := range []string{warning, setLayers(spec, r)} {
			if text != "" {
				warnings = append(warnings, text)
			}
		}
	}
	return spec, warnings, nil
}

// chosen is the name of the integrator where no pilot has to decide.
func chosen(r job.Request, report *scenev1.SceneReport) string {
	if r.Integrator == "" || r.Integrator == job.IntegratorAuto {
		return report.GetIntegrator()
	}
	return r.Integrator
}

func integrator(name string) jobv1.Integrator {
	return map[string]jobv1.Integrator{
		job.IntegratorPath:   jobv1.Integrator_INTEGRATOR_PATH,
		job.IntegratorBDPT:   jobv1.Integrator_INTEGRATOR_BDPT,
		job.IntegratorPSSMLT: jobv1.Integrator_INTEGRATOR_PSSMLT,
		job.IntegratorMMLT:   jobv1.Integrator_INTEGRATOR_MMLT,
	}[name]
}

func checkSize(spec *jobv1.ResolvedSpec) error {
	shape := film.Shape{Width: int(spec.Width), Height: int(spec.Height), Layers: 1}
	if err := shape.Validate(); err != nil {
		return &job.FieldError{Field: "width", Detail: err.Error()}
	}
	if spec.Width*spec.Height > maxPixels {
		return &job.FieldError{Field: "width", Detail: fmt.Sprintf("%d x %d has more than %d pixels", spec.Width, spec.Height, maxPixels)}
	}
	return nil
}

// setDepth limits the paths of mmlt: each length takes a share of the bootstrap.
func setDepth(spec *jobv1.ResolvedSpec, r job.Request) ([]string, error) {
	if r.MaxDepth != nil {
		spec.MaxDepth = int32(*r.MaxDepth)
	}
	asked := spec.MaxDepth
	switch {
	case !Multiplexed(spec) || asked >= 1 && asked <= LongestMultiplexed:
		return nil, nil
	case r.MaxDepth != nil && asked > LongestMultiplexed:
		return nil, &job.FieldError{
			Field:  "max_depth",
			Detail: fmt.Sprintf("is %d; mmlt takes 1..%d edges", asked, LongestMultiplexed),
		}
	case asked == 0:
		spec.MaxDepth = 1 // paths of no edge carry nothing either
		return nil, nil
	}
	spec.MaxDepth = LongestMultiplexed
	if asked == -1 {
		return nil, nil
	}
	return []string{fmt.Sprintf("max_depth is %d instead of the scene's %d: mmlt takes no longer paths", LongestMultiplexed, asked)}, nil
}

func setSegments(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) {
	samples := uint64(pilotSamples)
	if r.BootstrapSamples > 0 {
		samples = r.BootstrapSamples
	}
	spec.BootstrapSamples = roundUp(samples, film.Halves*GroupSize)
	blocks := (Cells(spec, report) + GroupSize - 1) / GroupSize
	spec.BlocksPerSegment = uint32(min(max(1, (blocks+targetSegments-1)/targetSegments), maxBlocksPerSegment))
}

// SetUnit fixes the film unit from the mean luminance of the bootstrap or pilot, unless the spec
// has one already (a repeated job). It reports black when chains have nothing to start from.
func SetUnit(spec *jobv1.ResolvedSpec, mean float64) (warning string, black bool) {
	chains := RunsChains(spec)
	switch {
	case !(mean > 0) && chains:
		warning, black = "no bootstrap sample carries light: the image is black", true
		mean = 1
	case !(mean > 0):
		warning = "no pilot sample carries light: the film unit is 1"
		mean = 1
	case !chains:
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
