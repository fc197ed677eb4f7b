// Package store defines what the coordinator keeps durably beside blobs: jobs, their events and the
// pointers to their checkpoints. Each transition is one method, atomic and durable when it returns.
// Package storetest has the conformance suite that every implementation passes.
package store

import (
	"context"
	"errors"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/round"
)

// ErrFenced: a newer owner has claimed the store; the caller must stop.
var ErrFenced = errors.New("store was claimed by a newer owner")

// ErrKeyReused: the idempotency key belongs to another request.
var ErrKeyReused = errors.New("idempotency key was used for another request")

// MaxEvents is how many events of a job are kept; older ones are dropped.
const MaxEvents = 512

// Record is the durable part of a job.
type Record struct {
	ID     string `json:"id"`
	Number uint64 `json:"number"` // order of creation, set by CreateJob

	Request     job.Request `json:"request"`
	State       job.State   `json:"state"`
	Paused      bool        `json:"paused,omitempty"`
	PauseReason string      `json:"pause_reason,omitempty"` // if the job paused itself
	Error       string      `json:"error,omitempty"`
	StopReason  string      `json:"stop_reason,omitempty"`
	Warnings    []string    `json:"warnings,omitempty"`
	CreatedAt   time.Time   `json:"created_at"`
	StartedAt   *time.Time  `json:"started_at,omitempty"`
	EndedAt     *time.Time  `json:"ended_at,omitempty"`

	// SceneReport is what a worker found in the scene, in protobuf JSON; empty before.
	SceneReport string `json:"scene_report,omitempty"`
	// Decision that a round is the last, recorded before it takes effect.
	Decision *round.Decision `json:"decision,omitempty"`
	// Checkpoint names the blob to resume from; empty before the first.
	Checkpoint string `json:"checkpoint,omitempty"`
	// Checkpoints counts those written so far, for names.
	Checkpoints uint64 `json:"checkpoints,omitempty"`
	// Sequence is at least the last event sequence number handed out.
	Sequence uint64 `json:"sequence"`

	// Summary and Convergence are set when the job has ended.
	Summary     *job.Snapshot          `json:"summary,omitempty"`
	Convergence []job.ConvergencePoint `json:"convergence,omitempty"`
}

// Store keeps records and events. Mutating methods carry the epoch of the caller's claim, the
// fencing token: under an older epoch than the last claim's they fail with ErrFenced and change
// nothing. Methods may be called from several goroutines.
type Store interface {
	// Claim makes the caller the owner and returns its epoch, higher than every one before.
	Claim(ctx context.Context) (epoch uint64, err error)

	// CreateJob stores a new job and sets its number. With a key that was used for an equal request
	// (same fingerprint) it returns the record of then and created false; for another request it
	// fails with ErrKeyReused. An empty key never matches.
	CreateJob(ctx context.Context, epoch uint64, r Record, key, fingerprint string) (stored Record, created bool, err error)

	// UpdateJob replaces a record and appends events, in one step. job.ErrNotFound if there is no
	// such job.
	UpdateJob(ctx context.Context, epoch uint64, r Record, events []job.Event) error

	// DeleteJob removes a job, its events and its idempotency key. job.ErrNotFound if there is none.
	DeleteJob(ctx context.Context, epoch uint64, id string) error

	// Jobs returns all records in order of creation.
	Jobs(ctx context.Context) ([]Record, error)

	// Events returns the kept events of a job with a sequence above after, in order.
	Events(ctx context.Context, id string, after uint64) ([]job.Event, error)

	// Close releases the store.
	Close() error
}
