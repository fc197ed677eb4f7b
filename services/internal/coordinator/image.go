package coordinator

import (
	"context"
	"errors"
	"fmt"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/develop"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/render"
)

// Image implements api.Service. The caller must not change the slices: they are shared.
func (c *Coordinator) Image(ctx context.Context, id string) (job.Image, error) {
	var read string // the checkpoint that was not there
	for {
		r, err := c.find(ctx, id)
		if err != nil {
			return job.Image{}, err
		}
		image, err := c.imageOf(ctx, r)
		if !errors.Is(err, blob.ErrNotFound) {
			return image, err
		}
		// The job may have gone on, maybe elsewhere, and have another checkpoint by now.
		missing := r.checkpointToRead()
		switch {
		case missing == read:
			return job.Image{}, err // it is lost
		case read != "":
			return job.Image{}, fmt.Errorf("job %s goes on: %w: %w", id, job.ErrUnavailable, err)
		}
		read = missing
	}
}

func (r *run) checkpointToRead() string {
	r.mu.Lock()
	defer r.mu.Unlock()
	return r.rec.Checkpoint
}

func (c *Coordinator) imageOf(ctx context.Context, r *run) (job.Image, error) {
	// One development of a job at a time: the others then find it done. Who has a place waits for no turn.
	until := time.Now().Add(c.options.ReadPatience)
	over, err := r.imageTurn.enter(ctx, r.id, 0, c.options.ReadPatience)
	if err != nil {
		return job.Image{}, err
	}
	defer over()
	r.mu.Lock()
	kept, err := r.keptImage()
	film, places := r.rec.FilmBytes, c.imaging
	if r.state == nil { // it is read, and kept until it is developed
		places = c.readers
	}
	r.mu.Unlock()
	if err != nil {
		return job.Image{}, err
	}
	if kept != nil {
		return *kept, nil
	}
	done, err := places.enter(ctx, r.id, film, time.Until(until))
	if err != nil {
		return job.Image{}, err
	}
	defer done()
	state, image, err := r.imageSource(ctx)
	if err != nil || state == nil {
		return image, err
	}
	r.developInto(&image, state)
	r.keepImage(&image)
	return image, nil
}

// keptImage returns the image that was developed before, or none if one must be developed, or why there is
// none. Requires: mu.
func (r *run) keptImage() (*job.Image, error) {
	switch {
	case r.loading:
		return nil, fmt.Errorf("job %s: its checkpoint is being read: %w", r.id, job.ErrUnavailable)
	case r.state == nil && r.rec.Checkpoint == "", r.state != nil && !r.shows(r.state):
		return nil, fmt.Errorf("job %s: %w", r.id, job.ErrNoImage)
	case r.image != nil && r.image.FilmSHA256 == r.snapshot().FilmSHA256 && r.image.Final == (r.rec.State == job.Done):
		return r.image, nil
	}
	return nil, nil
}

// shows tells whether there is something to see in a state of the job. Requires: mu.
func (r *run) shows(state *render.State) bool {
	return len(state.History()) > 0 || r.rec.State == job.Done
}

// imageSource returns the film to develop and the image's attributes, or no film and the image that
// was developed before.
func (r *run) imageSource(ctx context.Context) (*render.State, job.Image, error) {
	r.mu.Lock()
	defer r.mu.Unlock()
	switch kept, err := r.keptImage(); {
	case err != nil:
		return nil, job.Image{}, err
	case kept != nil:
		return nil, *kept, nil
	}
	state := r.state
	if state == nil {
		read, err := r.c.readCheckpoint(ctx, r.rec)
		if err != nil {
			return nil, job.Image{}, fmt.Errorf("image: %w", err)
		}
		if state = read.State; !r.shows(state) {
			return nil, job.Image{}, fmt.Errorf("job %s: %w", r.id, job.ErrNoImage)
		}
	}
	snapshot := r.snapshot()
	return state.Snapshot(), job.Image{
		Width: int(state.Spec.GetWidth()), Height: int(state.Spec.GetHeight()),
		SceneDigest: r.rec.Request.Scene, JobID: r.id, Integrator: snapshot.Integrator,
		Seed: state.Spec.GetSeed(), Rounds: len(state.History()), Final: r.rec.State == job.Done,
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
