package cli

import (
	"context"
	"errors"
	"fmt"
	"os"
	"time"

	"metrofarm/services/internal/job"
)

// jobSource is a coordinator, in this process or behind REST.
type jobSource interface {
	Job(ctx context.Context, id string) (job.Snapshot, error)
	Events(ctx context.Context, id string, after uint64) ([]job.Event, <-chan job.Event, error)
	Finish(ctx context.Context, id string) (job.Snapshot, error)
	Cancel(ctx context.Context, id string) (job.Snapshot, error)
}

var errAborted = errors.New("aborted")

// follower watches one job until it ends.
type follower struct {
	source     jobSource
	id         string
	reporter   *reporter
	interrupts <-chan os.Signal
	failed     <-chan error // nil: nothing else can fail

	last        job.Snapshot
	sequence    uint64
	interrupted bool
}

// follow returns the job's last snapshot. The first interrupt makes the round under way the last,
// the second cancels the job.
func (f *follower) follow(ctx context.Context) (job.Snapshot, error) {
	ticker := time.NewTicker(f.reporter.interval())
	defer ticker.Stop()
	defer f.reporter.clear()
	for {
		ended, err := f.watch(ctx, ticker.C)
		if err != nil {
			return f.last, err
		}
		// The stream ended before the job did: we were too slow, or the server went away. Or the job has
		// ended, unless that was before it was refined.
		if f.last, err = f.source.Job(ctx, f.id); err != nil {
			return f.last, err
		}
		if ended && f.last.State.Ended() {
			f.reporter.end(f.last)
			return f.last, outcome(f.last)
		}
	}
}

// watch reads one event stream. It returns true when the job has ended.
func (f *follower) watch(ctx context.Context, tick <-chan time.Time) (bool, error) {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	past, live, err := f.source.Events(ctx, f.id, f.sequence)
	if err != nil {
		return false, err
	}
	for _, event := range past {
		f.take(event)
	}
	for !f.last.State.Ended() {
		select {
		case <-ctx.Done():
			return false, ctx.Err()
		case event, open := <-live:
			if !open {
				return false, nil
			}
			f.take(event)
		case <-tick:
			if snapshot, err := f.source.Job(ctx, f.id); err == nil {
				f.last = snapshot
			}
			f.reporter.report(f.last)
		case err := <-f.failed:
			return false, err
		case <-f.interrupts:
			if err := f.interrupt(ctx); err != nil {
				return false, err
			}
		}
	}
	return true, nil
}

func (f *follower) take(event job.Event) {
	f.sequence = max(f.sequence, event.Sequence)
	if event.Job != nil {
		f.last = *event.Job
	}
	switch event.Kind {
	case "warning", "fault", "anomaly":
		f.reporter.say("%s: %s", event.Kind, event.Message)
	}
}

func (f *follower) interrupt(ctx context.Context) error {
	if f.interrupted {
		_, err := f.source.Cancel(ctx, f.id)
		return errors.Join(errAborted, err)
	}
	f.interrupted = true
	f.reporter.say("finishing the round under way; interrupt again to abort")
	_, err := f.source.Finish(ctx, f.id)
	return err
}

// outcome is the error of a job that did not succeed.
func outcome(s job.Snapshot) error {
	switch s.State {
	case job.Done:
		return nil
	case job.Failed:
		return errors.New(s.Error)
	default:
		return fmt.Errorf("job %s was %s", s.ID, s.State)
	}
}
