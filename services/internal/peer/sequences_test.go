package peer

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"log/slog"
	"net/http"
	"slices"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/sequence"
)

// split is a coordinator that knows of a sequence whose frames belong to others.
type split struct {
	*member
	frames []string
}

// Sequence shows the frames of the other coordinator as they were stored.
func (s split) Sequence(_ context.Context, id string) (job.Sequence, error) {
	if id != "seq-1" {
		return job.Sequence{}, fmt.Errorf("sequence %q: %w", id, job.ErrNotFound)
	}
	var frames []job.Frame
	for i, id := range s.frames {
		f := job.Frame{Number: i, Job: id, State: job.Queued, Stale: true, Owner: s.other.url}
		if !slices.Contains(s.other.own, id) {
			f.State, f.Stale, f.Owner = job.Deleted, false, ""
			if j, err := s.Job(context.Background(), id); err == nil {
				f.Take(j)
			}
		}
		frames = append(frames, f)
	}
	q := job.Sequence{ID: id}
	q.SetFrames(frames)
	return q, nil
}

// newSplit makes a farm of two coordinators that own frames 0 and 1, and 2, of a sequence.
func newSplit(t *testing.T) (owner *member, farm *Farm) {
	t.Helper()
	owner, asked, first := newFarm(t)
	second, err := owner.Submit(t.Context(), job.Request{Scene: "s", Entry: "second"}, "")
	if err != nil {
		t.Fatal(err)
	}
	owner.own = append(owner.own, second.ID)
	for range 3 { // so that its frame has an id that the other does not know
		if _, err := asked.Submit(t.Context(), job.Request{Scene: "s", Entry: "e"}, ""); err != nil {
			t.Fatal(err)
		}
	}
	for _, id := range []string{"j1", "j2"} {
		if _, err := asked.Cancel(t.Context(), id); err != nil {
			t.Fatal(err)
		}
		if err := asked.Delete(t.Context(), id); err != nil {
			t.Fatal(err)
		}
	}
	asked.own = []string{"j3"}
	return owner, New(split{asked, []string{first, second.ID, "j3"}}, Options{Logger: slog.New(slog.DiscardHandler)})
}

func TestTheOwnersShowTheirFrames(t *testing.T) {
	owner, farm := newSplit(t)
	owner.Update(owner.own[1], "state", "", func(j *job.Snapshot) { j.State, j.RoundsDone = job.Rendering, 5 })
	q, err := farm.Sequence(t.Context(), "seq-1")
	if err != nil || q.State != job.Rendering || q.Frames[0].Stale || q.Frames[1].RoundsDone != 5 || q.Frames[2].State != job.Queued {
		t.Errorf("%+v, error %v", q, err)
	}
	owner.server.Close()
	if q, err = farm.Sequence(t.Context(), "seq-1"); err != nil || !q.Frames[0].Stale || q.Frames[2].Stale {
		t.Errorf("without the owner: %+v, error %v", q, err)
	}
}

func TestActionsReachTheFramesOfAll(t *testing.T) {
	owner, farm := newSplit(t)
	q, err := sequence.Pause(t.Context(), farm, "seq-1")
	if err != nil || !q.Frames[0].Paused || !q.Frames[1].Paused || !q.Frames[2].Paused {
		t.Errorf("paused %+v, error %v", q, err)
	}
	if _, err := owner.Finish(t.Context(), owner.own[0]); err != nil {
		t.Fatal(err)
	}
	if q, err = sequence.Cancel(t.Context(), farm, "seq-1"); err != nil || q.States[job.Canceled] != 2 || q.States[job.Done] != 1 {
		t.Errorf("canceled %+v, error %v", q, err)
	}
	if err := sequence.Delete(t.Context(), farm, "seq-1"); err != nil {
		t.Error(err)
	}
	for _, m := range []*member{owner, owner.other} {
		if jobs := m.Own(); len(jobs) != 0 {
			t.Errorf("left: %+v", jobs)
		}
	}
}

func TestActionsOnTheFramesOfAnOwnerThatIsGone(t *testing.T) {
	owner, farm := newSplit(t)
	owner.server.Close()
	if _, err := sequence.Cancel(t.Context(), farm, "seq-1"); !errors.Is(err, job.ErrUnavailable) {
		t.Errorf("cancel: %v", err)
	}
}

// TestAJobThatEndedMeanwhile: what the owner answers is told from a failure.
func TestAJobThatEndedMeanwhile(t *testing.T) {
	owner, farm := newSplit(t)
	if _, err := owner.Finish(t.Context(), owner.own[0]); err != nil {
		t.Fatal(err)
	}
	ctx := t.Context()
	if _, err := farm.Cancel(ctx, owner.own[0]); !errors.Is(err, job.ErrConflict) {
		t.Errorf("cancel: %v", err)
	}
	if err := farm.Delete(ctx, "unknown"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("delete: %v", err)
	}
	var problem struct{ Status int }
	_, body := do(t, http.MethodPost, owner.url+"/v1/jobs/"+owner.own[0]+"/cancel", nil)
	if err := json.Unmarshal([]byte(body), &problem); err != nil || problem.Status != http.StatusConflict {
		t.Errorf("%s, error %v", body, err)
	}
}
