package plan

import (
	"fmt"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

// Limits on what one job may take; 0 means none.
type Limits struct {
	// Pixels of the image.
	Pixels uint64
	// Chains that it runs.
	Chains uint64
	// PerPixel mutations or samples, where the job ends by count.
	PerPixel uint64
	// CoordinatorBytes and WorkerBytes of memory, as estimated.
	CoordinatorBytes, WorkerBytes uint64
}

// Sizes that the estimates of memory count with.
const (
	coordinatorValue = 16 // bytes of a sum, see package film
	workerValue      = 8
	// The coordinator holds the closed rounds and up to two open ones, a worker the film it renders
	// and the one it delivers.
	coordinatorFilms = 3
	workerFilms      = 2
	// chainBytes of a state with its seeds; long paths take more.
	chainBytes = 2 << 10
)

// Memory estimates what a job takes in the coordinator and in each worker, beside its scene, once
// light has reached every part of the film.
func Memory(spec *jobv1.ResolvedSpec) (coordinator, worker uint64) {
	shape := Shape(spec)
	tiles := uint64(shape.TilesX()) * uint64(shape.TilesY()) * uint64(shape.FullPlanes())
	low := uint64(shape.LowPlanes()) * film.LowTileValues
	values := tiles*film.FullTileValues + low
	chains := uint64(Chains(spec)) * chainBytes
	return coordinatorFilms * (values*coordinatorValue + chains), workerFilms*values*workerValue + chains
}

// CheckRequest checks what can be told without the scene. Errors are *job.FieldError.
func (l Limits) CheckRequest(r job.Request) error {
	if r.Resolved != "" {
		spec, err := ParseResolved(r.Resolved)
		if err != nil {
			return err
		}
		if err := l.checkSize(spec, "resolved"); err != nil {
			return err
		}
		if err := l.checkCount("resolved", "chains", uint64(Chains(spec)), l.Chains); err != nil {
			return err
		}
		return l.checkRounds("resolved", spec, r.Stop)
	}
	pixels := uint64(max(1, r.Width)) * uint64(max(1, r.Height))
	for _, check := range []error{
		l.checkCount(sizeField(r), "pixels", pixels, l.Pixels),
		l.checkCount("chains", "chains", r.Chains, l.Chains),
		l.checkCount("stop.samples_per_pixel", "samples per pixel", r.Stop.SamplesPerPixel, l.PerPixel),
		l.checkCount("stop.mutations_per_pixel", "mutations per pixel", r.Stop.MutationsPerPixel, l.PerPixel),
	} {
		if check != nil {
			return check
		}
	}
	if r.Width == 0 || r.Height == 0 {
		return nil
	}
	return l.checkSize(smallest(r), sizeField(r))
}

// smallest is the spec of the smallest film that a job can have whose size is given: what its scene and
// its integrator add is known later.
func smallest(r job.Request) *jobv1.ResolvedSpec {
	spec := &jobv1.ResolvedSpec{Width: uint32(r.Width), Height: uint32(r.Height)}
	switch r.Integrator {
	case job.IntegratorPSSMLT:
		spec.Integrator = jobv1.Integrator_INTEGRATOR_PSSMLT
	case job.IntegratorMMLT:
		spec.Integrator = jobv1.Integrator_INTEGRATOR_MMLT
	}
	if RunsChains(spec) {
		setLayers(spec, r)
	}
	return spec
}

// Check a resolved spec. Errors are *job.FieldError: they name what the user set or could set.
func (l Limits) Check(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) error {
	if err := l.checkCount("chains", "chains", uint64(Chains(spec)), l.Chains); err != nil {
		return err
	}
	if err := l.checkPerPixel(spec, r, report); err != nil {
		return err
	}
	return l.checkSize(spec, sizeField(r))
}

func (l Limits) checkPerPixel(spec *jobv1.ResolvedSpec, r job.Request, report *scenev1.SceneReport) error {
	if r.Resolved != "" {
		return l.checkRounds("resolved", spec, r.Stop)
	}
	if r.Stop.Rounds > 0 {
		if err := l.checkRounds("stop.rounds", spec, r.Stop); err != nil {
			return err
		}
	}
	field := "stop.samples_per_pixel"
	if RunsChains(spec) {
		field = "stop.mutations_per_pixel"
	}
	return l.checkCount(field, "per pixel", requestedPerPixel(spec, r, report), l.PerPixel)
}

func (l Limits) checkSize(spec *jobv1.ResolvedSpec, field string) error {
	pixels := uint64(spec.GetWidth()) * uint64(spec.GetHeight())
	if err := l.checkCount(field, "pixels", pixels, l.Pixels); err != nil {
		return err
	}
	coordinator, worker := Memory(spec)
	if err := l.checkMemory(field, "the coordinator", coordinator, l.CoordinatorBytes); err != nil {
		return err
	}
	return l.checkMemory(field, "each worker", worker, l.WorkerBytes)
}

func (l Limits) checkCount(field, what string, asked, most uint64) error {
	if most == 0 || asked <= most {
		return nil
	}
	return &job.FieldError{Field: field, Detail: fmt.Sprintf("asks for %d %s; this server takes at most %d", asked, what, most)}
}

func (l Limits) checkMemory(field, where string, needed, most uint64) error {
	if most == 0 || needed <= most {
		return nil
	}
	const mebi = 1 << 20
	return &job.FieldError{Field: field, Detail: fmt.Sprintf(
		"the film and the chains would take %d MiB in %s; this server allows %d MiB: ask for fewer pixels, layers or chains",
		needed/mebi, where, most/mebi)}
}

// sizeField is the field to blame for the image's size.
func sizeField(r job.Request) string {
	if r.Height > r.Width {
		return "height"
	}
	return "width"
}
