package coordinator

import (
	"context"
	"fmt"

	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/render"
)

// Image implements api.Service. The caller must not change the slices: they are shared.
func (c *Coordinator) Image(ctx context.Context, id string) (job.Image, error) {
	r, err := c.find(ctx, id)
	if err != nil {
		return job.Image{}, err
	}
	// One development of a job at a time: the others then find it done.
	r.imageMu.Lock()
	defer r.imageMu.Unlock()
	if film, stored := r.storedFilm(); stored { // it is read, and kept until it is developed
		done, err := c.readers.enter(ctx, r.id, film, c.options.ReadPatience)
		if err != nil {
			return job.Image{}, err
		}
		defer done()
	}
	state, image, err := r.imageSource(ctx)
	if err != nil || state == nil {
		return image, err
	}
	r.developInto(&image, state)
	r.keepImage(&image)
	return image, nil
}

// storedFilm is what a film takes that is only in a checkpoint.
func (r *run) storedFilm() (bytes int64, stored bool) {
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.rec.FilmBytes, r.state == nil && !r.loading && r.rec.Checkpoint != ""
}

// imageSource returns the film to develop and the image's attributes, or no film and the image that
// was developed before.
func (r *run) imageSource(ctx context.Context) (*render.State, job.Image, error) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.loading {
		return nil, job.Image{}, fmt.Errorf("job %s: its checkpoint is being read: %w", r.id, job.ErrUnavailable)
	}
	state := r.state
	if state == nil && r.rec.Checkpoint != "" {
		read, err := r.c.readCheckpoint(ctx, r.rec)
		if err != nil {
			return nil, job.Image{}, fmt.Errorf("image: %w", err)
		}
		state = read.State
	}
	if state == nil || len(state.History()) == 0 && r.rec.State != job.Done {
		return nil, job.Image{}, fmt.Errorf("job %s: %w", r.id, job.ErrNoImage)
	}
	final := r.rec.State == job.Done
	snapshot := r.snapshot()
	if r.image != nil && r.image.FilmSHA256 == snapshot.FilmSHA256 && r.image.Final == final {
		return nil, *r.image, nil
	}
	return state.Snapshot(), job.Image{
		Width: int(state.Spec.GetWidth()), Height: int(state.Spec.GetHeight()),
		SceneDigest: r.rec.Request.Scene, JobID: r.id, Integrator: snapshot.Integrator,
		Seed: state.Spec.GetSeed(), Rounds: len(state.History()), Final: final,
		B: snapshot.B, BStandardError: snapshot.BStandardError, FilmSHA256: snapshot.FilmSHA256,
	}, nil
}

func (r *run) developInto(image *job.Image, state *render.State) {
	images := develop.Develop(state.Total, state.Scales())
	image.RGB, image.Variance, image.Layers = images.RGB(), images.VarianceImage(), state.Layers()
	image.Mutations = state.Account.Counts.Mutations
	if points := state.History(); len(points) > 0 {
		p := points[len(points)-1]
		image.B, image.BStandardError, image.RelMSE, image.FilmSHA256 = p.B, p.BStandardError, p.RelMSE, p.FilmSHA256
	}
}

// keepImage remembers the image of a running job: previews ask for it often.
func (r *run) keepImage(image *job.Image) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.state != nil {
		kept := *image
		r.image = &kept
	}
}
