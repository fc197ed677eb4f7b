// Package api serves the REST interface, the live event stream and the dashboard page. Handlers
// decode, call the Service, and encode; what a job is and how it runs is none of their business.
package api

import (
	"context"

	"metrofarm/services/internal/job"
)

// Service is what the handlers need of a coordinator. Errors are the sentinels of package job
// (job.ErrNotFound, ...), wrapped with what the user should know; errors.go maps them to statuses.
type Service interface {
	// Submit stores a job durably before it returns. A repeated idempotency key with an equal
	// request returns the first job; with another request it fails with job.ErrConflict.
	Submit(ctx context.Context, request job.Request, idempotencyKey string) (job.Snapshot, error)
	// Job returns one job.
	Job(ctx context.Context, id string) (job.Snapshot, error)
	// Jobs lists jobs, newest first, starting after the job with id cursor ("" for the newest).
	Jobs(ctx context.Context, cursor string, limit int) (jobs []job.Snapshot, next string, err error)
	// Live lists the jobs that have not ended, in any order; one that ends may be among them for a moment.
	Live(ctx context.Context) ([]job.Snapshot, error)
	// Delete removes a job that has ended, with its checkpoint and events.
	Delete(ctx context.Context, id string) error
	// Cancel ends a job; its image so far stays.
	Cancel(ctx context.Context, id string) (job.Snapshot, error)
	// Pause stops handing out work; Resume goes on.
	Pause(ctx context.Context, id string) (job.Snapshot, error)
	Resume(ctx context.Context, id string) (job.Snapshot, error)
	// Finish makes the round under way the last.
	Finish(ctx context.Context, id string) (job.Snapshot, error)
	// Change changes the name or the priority of a job that has not ended.
	Change(ctx context.Context, id string, change job.Change) (job.Snapshot, error)
	// Refine lets a job that has ended go on, under the same id, until these rules end it, which replace
	// those before. Its image will be that of a job that was submitted with them. Repeated with the same
	// rules it changes nothing; job.ErrInvalid if one asks for no more than there is. It is stored durably
	// before it returns.
	Refine(ctx context.Context, id string, stop job.StopRules) (job.Snapshot, error)
	// SubmitSequence stores a sequence with a job for each of its frames, all of them or none, durably
	// before it returns. Keys are as in Submit.
	SubmitSequence(ctx context.Context, request job.SequenceRequest, idempotencyKey string) (job.Sequence, error)
	// Sequence returns one sequence with its frames.
	Sequence(ctx context.Context, id string) (job.Sequence, error)
	// Sequences lists sequences, newest first and without their frames, starting after the one with id
	// cursor ("" for the newest).
	Sequences(ctx context.Context, cursor string, limit int) (sequences []job.Sequence, next string, err error)
	// Convergence returns one point per complete round.
	Convergence(ctx context.Context, id string) ([]job.ConvergencePoint, error)
	// SceneReport returns what a worker found in the job's scene (metrofarm.scene.v1.SceneReport in
	// protobuf JSON); job.ErrNoReport before one has looked.
	SceneReport(ctx context.Context, id string) (string, error)
	// Image develops the complete rounds so far; job.ErrNoImage before the first.
	Image(ctx context.Context, id string) (job.Image, error)
	// Deleted returns the jobs that were deleted since there were so many, and how many there are now:
	// of this farm, and as far as this process has heard of it.
	Deleted(after uint64) (ids []string, last uint64)
	// Events returns the events with a sequence above after and a channel of those that follow,
	// closed when ctx ends, when the reader falls too far behind, and when a job that had ended goes on or
	// is deleted (the reader then connects again).
	Events(ctx context.Context, id string, after uint64) ([]job.Event, <-chan job.Event, error)
	// Workers lists the workers that have been seen.
	Workers(ctx context.Context) ([]job.Worker, error)
	// Drain asks a worker to finish what it holds and leave.
	Drain(ctx context.Context, id string) (job.Worker, error)
}
