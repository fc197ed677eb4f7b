// Package store defines what coordinators keep durably beside blobs: jobs, their events, the
// pointers to their checkpoints, and who owns which job. Each transition is one method, atomic and
// durable when it returns. Package storetest has the conformance suite that every implementation
// passes.
//
// Several coordinators share a store. A job is owned through a lease that its owner renews; when
// the lease runs out, another coordinator may acquire the job. Each acquisition raises the job's
// epoch, the fencing token: what a former owner writes fails with ErrFenced, however late it wakes
// up. Expiry is decided by the store's clock, so those of the coordinators need not agree.
package store

import (
	"context"
	"errors"
	"fmt"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/round"
)

// ErrFenced: the caller does not own the job any more, or the update is older than the last. It must
// stop acting on the job.
var ErrFenced = errors.New("another coordinator has taken the job over")

// ErrOwned: the job has an owner whose lease has not run out.
var ErrOwned = errors.New("the job is owned by another coordinator")

// ErrKeyReused: the idempotency key belongs to another request.
var ErrKeyReused = errors.New("idempotency key was used for another request")

// ErrNotJSON: a record or an event has a value that no JSON document can hold, an infinite number or one
// that is none. It speaks against the job, not against the store.
var ErrNotJSON = errors.New("it has a value that cannot be stored")

// ErrUnavailable: the store cannot be reached now. Whether the change was made is unknown; making it
// again is safe.
var ErrUnavailable = fmt.Errorf("store: %w", job.ErrUnavailable)

// MaxEvents is how many events of a job are kept; older ones are dropped.
const MaxEvents = 512

// MaxChanges is how many changes of jobs at rest are kept for who asks; older ones are dropped.
const MaxChanges = 4096

// Change is what happened to a job at rest, which nobody owns and whose owner hence tells nobody: it was
// deleted, or it goes on.
type Change struct {
	ID      string
	Deleted bool
}

// Member is a coordinator that shares the store.
type Member struct {
	// ID is new for each start of a process.
	ID string `json:"id"`
	// REST is the URL at which other coordinators reach its REST interface; empty if it has none.
	REST string `json:"rest,omitempty"`
	// Farm is the HOST:PORT that workers connect to; empty if it has none.
	Farm string `json:"farm,omitempty"`
	// Secret comes with requests that other members pass on to this one.
	Secret string `json:"secret,omitempty"`
	// Usage is the CPU time, in seconds, that work for each user's jobs took of late: package fairness.
	Usage map[string]float64 `json:"usage,omitempty"`
	// Jobs that it owns and that have not ended, by user.
	Jobs map[string]int `json:"jobs,omitempty"`
}

// Claim says who wants to own a job, and for how long unless it renews.
type Claim struct {
	Owner string // Member.ID
	TTL   time.Duration
}

// Owned is a record with the member that owns it.
type Owned struct {
	Record
	// Owner is the zero Member if nobody does: the lease ran out or was released.
	Owner Member
}

// Record is the durable part of a job.
type Record struct {
	ID     string `json:"id"`
	Number uint64 `json:"number"` // order of creation, set by CreateJob

	// Revision grows by at least one with every update of an owner, so that an old one that arrives
	// late changes nothing.
	Revision uint64 `json:"revision"`

	User string `json:"user,omitempty"` // who submitted it
	// FrameOf tells of the sequence that the job is a frame of; it never changes.
	FrameOf     *job.FrameOf `json:"frame_of,omitempty"`
	Request     job.Request  `json:"request"`
	State       job.State    `json:"state"`
	Paused      bool         `json:"paused,omitempty"`
	PauseReason string       `json:"pause_reason,omitempty"` // if the job paused itself
	Error       string       `json:"error,omitempty"`
	StopReason  string       `json:"stop_reason,omitempty"`
	Warnings    []string     `json:"warnings,omitempty"`
	CreatedAt   time.Time    `json:"created_at"`
	StartedAt   *time.Time   `json:"started_at,omitempty"`
	EndedAt     *time.Time   `json:"ended_at,omitempty"`

	// SceneReport is what a worker found in the scene, in protobuf JSON; empty before.
	SceneReport string `json:"scene_report,omitempty"`
	// Refinements counts how often the job was refined. It is part of the names of tasks: what was
	// rendered for the job before cannot be taken for a part of what it renders now.
	Refinements uint64 `json:"refinements,omitempty"`
	// Unwound counts how often open rounds were thrown away. It is part of the names of tasks, likewise.
	Unwound uint64 `json:"unwound,omitempty"`
	// Contested is an open round of which the checkpoint may hold a segment that workers disagree about:
	// whoever goes on from it renders that round and those after it again.
	Contested *int `json:"contested,omitempty"`
	// Decision that a round is the last, recorded before it takes effect.
	Decision *round.Decision `json:"decision,omitempty"`
	// FilmBytes is what its film and chains may take in a coordinator's memory; 0 before it is known.
	FilmBytes int64 `json:"film_bytes,omitempty"`
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

// Sequence is a range of frames, each rendered by a job. It is stored with its jobs in one step, never
// changes, and is there as long as one of them is.
type Sequence struct {
	ID string `json:"id"`
	// Number is that of the first frame's job, set by CreateSequence; those of the others follow.
	Number    uint64              `json:"number"`
	User      string              `json:"user,omitempty"` // who submitted it
	Request   job.SequenceRequest `json:"request"`
	CreatedAt time.Time           `json:"created_at"`
	// Jobs of the frames, in order.
	Jobs []string `json:"jobs"`
	// States of the jobs, as they were last stored; job.Deleted where a job is gone. Only in answers.
	States []job.State `json:"-"`
}

// Store keeps records, events and leases. Methods may be called from several goroutines, and may be
// repeated after ErrUnavailable. Methods that take an epoch fail with ErrFenced and change nothing
// if it is not the job's, and with job.ErrNotFound if there is no such job.
type Store interface {
	// SwapFarm replaces the id of the farm that the store belongs to by next if it is old, and returns what
	// it is then. "" is none: with two of them nothing changes. Package farmid says what it is for.
	SwapFarm(ctx context.Context, old, next string) (now string, err error)

	// Beat keeps m among the members for ttl, and renews its leases of the held jobs (epochs by id).
	// It returns those that it does not own any more. A lease that has run out is renewed unless
	// somebody else has acquired the job.
	Beat(ctx context.Context, m Member, ttl time.Duration, held map[string]uint64) (lost []string, err error)

	// Leave ends a membership and releases the held jobs that it still owns.
	Leave(ctx context.Context, member string, held map[string]uint64) error

	// Members returns those whose time has not run out, by ID.
	Members(ctx context.Context) ([]Member, error)

	// CreateJob stores a new job, owned by the claimant under epoch 1, and sets its number. With a key
	// that was used for an equal request (same fingerprint) it returns the record of then and created
	// false; for another request it fails with ErrKeyReused. An empty key never matches.
	CreateJob(ctx context.Context, c Claim, r Record, key, fingerprint string) (stored Record, created bool, err error)

	// CreateSequence stores a sequence with the jobs of its frames, all of them or none, and sets the
	// numbers: s.Jobs names the jobs. The claimant owns them under epoch 1. Keys are those of CreateJob;
	// one that was used for an equal request returns the sequence of then.
	CreateSequence(ctx context.Context, c Claim, s Sequence, jobs []Record, key, fingerprint string) (stored Sequence, created bool, err error)

	// UpdateJob replaces a record and appends events, in one step. A repetition of the last update
	// (same revision) changes nothing; an older revision fails with ErrFenced. What is not JSON fails with
	// ErrNotJSON, and nothing of it is stored.
	UpdateJob(ctx context.Context, epoch uint64, r Record, events []job.Event) error

	// DeleteJob removes a job, its events and its idempotency key; with the last job of a sequence that,
	// too.
	DeleteJob(ctx context.Context, epoch uint64, id string) error

	// Release gives a job up. One that has ended then waits for no owner, until it is acquired again.
	Release(ctx context.Context, epoch uint64, id string) error

	// Waiting lists jobs that want an owner and have none: those that nobody has released since they
	// ended.
	Waiting(ctx context.Context) ([]string, error)

	// Acquire makes the claimant the owner of a job and raises its epoch. It fails with ErrOwned while
	// the lease of another owner lasts.
	Acquire(ctx context.Context, c Claim, id string) (r Record, epoch uint64, err error)

	// Job returns one job.
	Job(ctx context.Context, id string) (Owned, error)

	// Jobs returns up to limit jobs with numbers below before, newest first; before 0 begins with the
	// newest.
	Jobs(ctx context.Context, before uint64, limit int) ([]Owned, error)

	// JobsByID returns those of the jobs that exist, in the order of the ids.
	JobsByID(ctx context.Context, ids []string) ([]Owned, error)

	// Sequence returns one sequence; job.ErrNotFound if there is none.
	Sequence(ctx context.Context, id string) (Sequence, error)

	// Sequences returns up to limit sequences with numbers below before, newest first; before 0 begins
	// with the newest.
	Sequences(ctx context.Context, before uint64, limit int) ([]Sequence, error)

	// Events returns the kept events of a job with a sequence above after, in order.
	Events(ctx context.Context, id string, after uint64) ([]job.Event, error)

	// Changes lists in order the jobs that were deleted, and those that had ended and go on, since a
	// mark of the caller's process; next is the mark to go on from. With an empty mark there are none,
	// and next is now.
	Changes(ctx context.Context, mark string) (changes []Change, next string, err error)

	// Close ends the use of the store by this process.
	Close() error
}
