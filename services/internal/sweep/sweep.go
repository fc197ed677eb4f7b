// Package sweep deletes what nobody needs any more: jobs that ended long ago, bundles that no job
// refers to and nobody used lately, files of no bundle, checkpoints of no job, and what writes that
// never ended left behind.
//
// It marks and sweeps beside uploads, submissions, and the sweepers of other coordinators:
//   - What was written or used within the grace period stays, whoever refers to it. Uploads renew the
//     time of their files, submissions that of their bundle's manifest.
//   - What is older goes only if two passes in a row found it unused. A job that is being submitted is
//     stored well within the time between them. The second pass comes soon after the first, so that
//     processes that live for minutes sweep, too.
//   - A file is unused only if no manifest names it, and a manifest that a pass removed still counts
//     in it: should a job have come to refer to it meanwhile, the next pass puts it back, with all its
//     files in place.
package sweep

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"maps"
	"strings"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/checkpoint"
)

const (
	// checkpointGrace is how long a checkpoint may wait for its job to refer to it.
	checkpointGrace = time.Hour
	// unfinishedGrace is how long a write may take.
	unfinishedGrace = 24 * time.Hour
	defaultInterval = time.Hour
	// secondPass is how long after the first the second one comes.
	secondPass = time.Minute
)

// Job is what a job refers to.
type Job struct {
	ID string
	// Scene is the digest of its bundle.
	Scene string
	// Checkpoint is the name of its blob; "": none.
	Checkpoint string
	// EndedAt is zero while it has not ended.
	EndedAt time.Time
	// KeptFrom is when the time begins that it stays: EndedAt or later; zero while that has not come.
	KeptFrom time.Time
}

// Jobs is where the jobs are.
type Jobs interface {
	// Jobs lists all jobs, those of other coordinators too.
	Jobs(ctx context.Context) ([]Job, error)
	// Delete deletes a job that has ended, unless it has gone on since it was listed.
	Delete(ctx context.Context, j Job) error
}

// Options of a sweeper. Blobs and Jobs are required.
type Options struct {
	Blobs *blob.Store
	Jobs  Jobs
	// SameFarm fails if the jobs are not those that the blobs belong to. It is asked when the jobs are listed
	// and nothing is deleted yet; nil: nobody is.
	SameFarm func(context.Context) error
	// KeepJobs is how long ended jobs stay; 0: for ever.
	KeepJobs time.Duration
	// KeepScenes is how long bundles stay that no job refers to, from their last use; 0: for ever. It
	// must be longer than an upload may take.
	KeepScenes time.Duration
	// Interval between two passes; 0: an hour.
	Interval time.Duration
	// Now is the clock; nil: the machine's.
	Now    func() time.Time
	Logger *slog.Logger
}

// Sweeper sweeps. It is used by one goroutine.
type Sweeper struct {
	Options
	// unused are the blobs that the last pass would have deleted, had it been the second to say so.
	unused map[blob.Key]bool
	// removed are the bundles whose manifests the last pass deleted.
	removed map[string][]blob.File
}

// New returns a sweeper that has not swept yet.
func New(options Options) *Sweeper {
	if options.Now == nil {
		options.Now = time.Now
	}
	if options.Logger == nil {
		options.Logger = slog.New(slog.DiscardHandler)
	}
	if options.Interval == 0 {
		options.Interval = defaultInterval
	}
	return &Sweeper{Options: options, removed: make(map[string][]blob.File)}
}

// Run sweeps until ctx ends. A pass that fails is logged; the next one tries again.
func (s *Sweeper) Run(ctx context.Context) {
	for pause := min(secondPass, s.Interval); ; pause = s.Interval {
		counts, err := s.Sweep(ctx)
		if err != nil && ctx.Err() == nil {
			s.Logger.Error("sweeping failed", "error", err)
		}
		if counts != (Counts{}) {
			s.Logger.Info("swept", "jobs", counts.Jobs, "scenes", counts.Manifests, "files", counts.Files,
				"checkpoints", counts.Checkpoints, "scenes_put_back", counts.PutBack)
		}
		select {
		case <-ctx.Done():
			return
		case <-time.After(pause):
		}
	}
}

// Counts is what a pass deleted, and how many manifests it put back.
type Counts struct{ Jobs, Manifests, Files, Checkpoints, PutBack int }

// pass is one sweep.
type pass struct {
	*Sweeper
	counts      Counts
	start       time.Time
	scenes      map[string]bool // that jobs refer to
	checkpoints map[string]bool // likewise
	files       map[string]bool // that bundles name
	unused      map[blob.Key]bool
	removed     map[string][]blob.File
}

// Sweep makes one pass.
func (s *Sweeper) Sweep(ctx context.Context) (Counts, error) {
	p := &pass{
		Sweeper: s, start: s.Now(), scenes: make(map[string]bool), checkpoints: make(map[string]bool),
		files: make(map[string]bool), unused: make(map[blob.Key]bool), removed: make(map[string][]blob.File),
	}
	err := p.jobs(ctx)
	if err == nil {
		err = errors.Join(p.bundles(ctx), p.orphans(ctx))
	}
	if err != nil {
		maps.Copy(s.removed, p.removed) // the next pass may have to put them back
		return p.counts, fmt.Errorf("sweep: %w", err)
	}
	s.unused, s.removed = p.unused, p.removed
	// Not every store lets its users list unfinished uploads; all else is done by now.
	if err := s.Blobs.RemoveUnfinished(ctx, p.start.Add(-unfinishedGrace)); err != nil {
		return p.counts, fmt.Errorf("sweep: %w", err)
	}
	return p.counts, nil
}

// jobs deletes those that ended long ago and notes what the others refer to.
func (p *pass) jobs(ctx context.Context) error {
	jobs, err := p.Jobs.Jobs(ctx)
	if err != nil {
		return err
	}
	if p.SameFarm != nil {
		if err := p.SameFarm(ctx); err != nil {
			return err
		}
	}
	for _, job := range jobs {
		if p.KeepJobs > 0 && !job.KeptFrom.IsZero() && p.start.Sub(job.KeptFrom) > p.KeepJobs {
			err := p.Jobs.Delete(ctx, job)
			if err == nil {
				p.counts.Jobs++
				continue
			}
			p.Logger.Warn("old job stays", "job", job.ID, "error", err)
		}
		p.scenes[job.Scene], p.checkpoints[job.Checkpoint] = true, true
	}
	return nil
}

// bundles deletes manifests, then files.
func (p *pass) bundles(ctx context.Context) error {
	if p.KeepScenes == 0 {
		return nil
	}
	if err := p.putBack(ctx); err != nil {
		return err
	}
	for info, err := range p.Blobs.List(ctx, blob.Manifests) {
		if err == nil {
			err = p.manifest(ctx, info)
		}
		if err != nil {
			return err // without all manifests we do not know which files are used
		}
	}
	for info, err := range p.Blobs.List(ctx, blob.Files) {
		if err != nil {
			return err
		}
		if p.files[info.Name] {
			continue
		}
		gone, err := p.discard(ctx, blob.Files, info, p.KeepScenes)
		if err != nil {
			return err
		}
		if gone {
			p.counts.Files++
		}
	}
	return nil
}

// putBack undoes the removal of manifests that jobs refer to by now.
func (p *pass) putBack(ctx context.Context) error {
	for digest, files := range p.Sweeper.removed {
		if !p.scenes[digest] {
			continue
		}
		switch _, err := p.Blobs.PutManifest(ctx, files); {
		case errors.Is(err, blob.ErrNotFound):
			p.Logger.Error("a scene was removed while a job came to need it; upload it again", "scene", digest, "error", err)
			continue
		case err != nil:
			return fmt.Errorf("putting a manifest back: %w", err)
		}
		p.counts.PutBack++
	}
	return nil
}

// manifest notes the files of a manifest, and deletes it if nobody uses it.
func (p *pass) manifest(ctx context.Context, info blob.Info) error {
	files, err := p.Blobs.Manifest(ctx, info.Name)
	if errors.Is(err, blob.ErrNotFound) {
		return nil // another sweeper was here
	}
	if err != nil {
		return err
	}
	for _, file := range files {
		p.files[file.SHA256] = true
	}
	if p.scenes[info.Name] {
		return nil
	}
	gone, err := p.discard(ctx, blob.Manifests, info, p.KeepScenes)
	if gone {
		p.removed[info.Name] = files
		p.counts.Manifests++
	}
	return err
}

// orphans deletes checkpoints that no job refers to.
func (p *pass) orphans(ctx context.Context) error {
	for info, err := range p.Blobs.List(ctx, blob.Named) {
		if err != nil {
			return err
		}
		if !strings.HasPrefix(info.Name, checkpoint.BlobPrefix) || p.checkpoints[info.Name] {
			continue
		}
		gone, err := p.discard(ctx, blob.Named, info, checkpointGrace)
		if err != nil {
			return err
		}
		if gone {
			p.counts.Checkpoints++
		}
	}
	return nil
}

// discard deletes an unused blob if it is old and the last pass found it unused too.
func (p *pass) discard(ctx context.Context, kind blob.Kind, info blob.Info, grace time.Duration) (gone bool, err error) {
	old := func(info blob.Info) bool { return p.start.Sub(info.Modified) > grace }
	key := blob.Key{Kind: kind, Name: info.Name}
	if !old(info) {
		return false, nil
	}
	if !p.Sweeper.unused[key] {
		p.unused[key] = true
		return false, nil
	}
	// The listing may be minutes old.
	info, err = p.Blobs.Stat(ctx, kind, info.Name)
	switch {
	case errors.Is(err, blob.ErrNotFound):
		return false, nil
	case err != nil || !old(info):
		return false, err
	}
	return true, p.Blobs.Delete(ctx, kind, info.Name)
}
