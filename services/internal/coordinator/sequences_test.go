package coordinator_test

import (
	"context"
	"errors"
	"fmt"
	"slices"
	"testing"
	"time"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/sequence"
	"metrofarm/services/internal/store"
	"metrofarm/services/internal/sweep"
)

// frames is a request for the frames 1 to last of a small image.
func (s *site) frames(last int, seeds string) job.SequenceRequest {
	s.t.Helper()
	request := job.SequenceRequest{Job: pathRequest(4), Frames: job.Frames{Start: 1, End: last, Seeds: seeds}}
	request.Job.Scene, request.Job.Entry = s.bundle(), "scene.xml"
	return request
}

func (s *site) submitFrames(request job.SequenceRequest) job.Sequence {
	s.t.Helper()
	q, err := s.c.SubmitSequence(s.t.Context(), request, "")
	s.check(err)
	return q
}

func (s *site) sequence(id string) job.Sequence {
	s.t.Helper()
	q, err := s.c.Sequence(s.t.Context(), id)
	s.check(err)
	return q
}

// rendered waits until all frames are done and returns their films' hashes.
func (s *site) rendered(q job.Sequence) (films []string) {
	s.t.Helper()
	for _, f := range q.Frames {
		films = append(films, s.finished(f.Job).FilmSHA256)
	}
	if after := s.sequence(q.ID); after.State != job.Done || after.States[job.Done] != len(q.Frames) || after.Frames[0].FilmSHA256 != films[0] {
		s.t.Errorf("the sequence is %+v", after)
	}
	return films
}

func TestFramesAreJobs(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	shared := s.submitFrames(s.frames(3, ""))
	if shared.State != job.Queued || len(shared.Frames) != 3 || shared.States[job.Queued] != 3 {
		t.Errorf("submitted %+v", shared)
	}
	apart := s.submitFrames(s.frames(3, job.SeedsPerFrame))
	s.crew(workers(2, nil)...)
	films := s.rendered(shared)
	if films[1] != films[0] || films[2] != films[0] {
		t.Errorf("frames of one seed: %v", films)
	}
	films = s.rendered(apart)
	if films[0] == films[1] || films[1] == films[2] || films[0] == films[2] {
		t.Errorf("frames of different seeds: %v", films)
	}
	for i, f := range apart.Frames {
		j := s.job(f.Job)
		if j.Sequence == nil || *j.Sequence != (job.FrameOf{ID: apart.ID, Frame: i + 1}) || j.Seed != 7+uint64(i+1) || f.Seed != j.Seed ||
			*j.Request.ShutterOpen != f.ShutterOpen || *j.Request.ShutterClose != f.ShutterClose {
			t.Errorf("frame %+v by job %+v", f, j)
		}
	}
	events, _, err := s.c.Events(t.Context(), apart.Frames[2].Job, 0)
	if err != nil || len(events) == 0 || events[0].Message != "accepted" {
		t.Errorf("events %+v, error %v", events, err)
	}
	list, next, err := s.c.Sequences(t.Context(), "", 1)
	if err != nil || len(list) != 1 || list[0].ID != apart.ID || list[0].States[job.Done] != 3 || list[0].Frames != nil || next != apart.ID {
		t.Errorf("list %+v, next %q, error %v", list, next, err)
	}
	if list, next, err = s.c.Sequences(t.Context(), next, 1); err != nil || len(list) != 1 || list[0].ID != shared.ID || next != "" {
		t.Errorf("list %+v, next %q, error %v", list, next, err)
	}
}

func TestSequencesAreRefusedWhole(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	for field, change := range map[string]func(*job.SequenceRequest){
		"frames.end":    func(r *job.SequenceRequest) { r.Frames.End = 0 },
		"job.scene":     func(r *job.SequenceRequest) { r.Job.Scene = "none" },
		"job.entry":     func(r *job.SequenceRequest) { r.Job.Entry = "other.xml" },
		"job.max_depth": func(r *job.SequenceRequest) { r.Job.MaxDepth = new(int) },
	} {
		request := s.frames(3, "")
		change(&request)
		var wrong *job.FieldError
		if _, err := s.c.SubmitSequence(t.Context(), request, ""); !errors.As(err, &wrong) || wrong.Field != field {
			t.Errorf("%s: %v", field, err)
		}
	}
	if jobs, _, err := s.c.Jobs(t.Context(), "", 10); err != nil || len(jobs) != 0 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
	if _, err := s.c.Sequence(t.Context(), "seq-none"); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("no such sequence: %v", err)
	}
	if _, _, err := s.c.Sequences(t.Context(), "seq-none", 1); !errors.Is(err, job.ErrInvalid) {
		t.Errorf("no such cursor: %v", err)
	}
}

func TestAKeySubmitsASequenceOnce(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	request := s.frames(3, "")
	first, err := s.c.SubmitSequence(t.Context(), request, "key")
	s.check(err)
	request.Job.Priority = 5 // no part of what is asked for
	if again, err := s.c.SubmitSequence(t.Context(), request, "key"); err != nil || again.ID != first.ID {
		t.Errorf("again %s, error %v", again.ID, err)
	}
	request.Frames.End = 4
	if _, err := s.c.SubmitSequence(t.Context(), request, "key"); !errors.Is(err, job.ErrConflict) {
		t.Errorf("another request: %v", err)
	}
	if jobs, _, err := s.c.Jobs(t.Context(), "", 10); err != nil || len(jobs) != 3 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
}

// mortalStore loses the answer to a creation, after it was made or before.
type mortalStore struct {
	store.Store
	after bool
}

func (m *mortalStore) CreateSequence(ctx context.Context, c store.Claim, q store.Sequence, jobs []store.Record, key, fingerprint string) (store.Sequence, bool, error) {
	if m.after {
		_, _, _ = m.Store.CreateSequence(ctx, c, q, jobs, key, fingerprint)
	}
	return store.Sequence{}, false, store.ErrUnavailable
}

// TestACrashWhileASequenceIsCreated kills the coordinator in the middle of a submission, which is then
// repeated: there are all frames, each once.
func TestACrashWhileASequenceIsCreated(t *testing.T) {
	for _, after := range []bool{false, true} {
		t.Run(fmt.Sprintf("after the step %v", after), func(t *testing.T) {
			s := newSite(t)
			s.tune = func(o *coordinator.Options) { o.Store = &mortalStore{o.Store, after} }
			s.start()
			request := s.frames(5, "")
			if _, err := s.c.SubmitSequence(t.Context(), request, "key"); !errors.Is(err, job.ErrUnavailable) {
				t.Fatalf("the answer was not lost: %v", err)
			}
			s.kill()
			s.tune = nil
			s.start()
			defer s.stop()
			q, err := s.c.SubmitSequence(t.Context(), request, "key")
			s.check(err)
			s.crew(workers(2, nil)...)
			s.rendered(q)
			if jobs, _, err := s.c.Jobs(t.Context(), "", 20); err != nil || len(jobs) != 5 {
				t.Errorf("%d jobs, error %v", len(jobs), err)
			}
			if all, _, err := s.c.Sequences(t.Context(), "", 20); err != nil || len(all) != 1 || all[0].ID != q.ID {
				t.Errorf("sequences %+v, error %v", all, err)
			}
		})
	}
}

// TestFramesSurviveTheCoordinator kills it while frames are rendered: they become what they would have.
func TestFramesSurviveTheCoordinator(t *testing.T) {
	calm := newSite(t)
	calm.start()
	calm.crew(workers(1, nil)...)
	want := calm.rendered(calm.submitFrames(calm.frames(4, job.SeedsPerFrame)))
	calm.stop()

	s := newSite(t)
	s.start()
	dismiss := s.crew(workers(2, nil)...)
	q := s.submitFrames(s.frames(4, job.SeedsPerFrame))
	s.finished(q.Frames[0].Job)
	s.kill()
	s.start()
	defer s.stop()
	if films := s.rendered(q); !slices.Equal(films, want) {
		t.Errorf("films %v, want %v", films, want)
	}
	dismiss()
}

// TestFramesShareTheFarm: who submits a long sequence does not keep others from it.
func TestFramesShareTheFarm(t *testing.T) {
	s := patientSite(t)
	ada := auth.With(t.Context(), auth.Identity{User: "ada"})
	request := s.frames(20, "")
	q, err := s.c.SubmitSequence(ada, request, "")
	s.check(err)
	if q.User != "ada" || s.job(q.Frames[19].Job).User != "ada" {
		t.Errorf("sequence of %q", q.User)
	}
	h := newHand(t, s.c, "a")
	s.await(q.Frames[19].Job, "stored", func(j job.Snapshot) bool {
		events, err := s.db.Events(t.Context(), j.ID, 0)
		s.check(err)
		return len(events) > 0
	})
	equal(t, "leases before bob", h.leasesOf(2), q.Frames[0].Job, q.Frames[1].Job)
	bob := s.submitAs("bob", 0, pathRequest(1))
	equal(t, "leases after bob", h.leasesOf(2), bob, q.Frames[2].Job)
}

func TestActionsOnTheWhole(t *testing.T) {
	ctx, s := t.Context(), newSite(t)
	s.start()
	defer s.stop()
	q := s.submitFrames(s.frames(3, ""))
	_, err := s.c.Cancel(ctx, q.Frames[1].Job)
	s.check(err)
	paused, err := sequence.Pause(ctx, s.c, q.ID)
	if err != nil || !paused.Frames[0].Paused || paused.Frames[1].Paused || !paused.Frames[2].Paused {
		t.Errorf("paused %+v, error %v", paused, err)
	}
	if err := sequence.Delete(ctx, s.c, q.ID); !errors.Is(err, job.ErrConflict) {
		t.Errorf("deleted while frames go on: %v", err)
	}
	if s.sequence(q.ID).States[job.Canceled] != 1 {
		t.Error("a refused deletion deleted something")
	}
	resumed, err := sequence.Resume(ctx, s.c, q.ID)
	if err != nil || resumed.Frames[0].Paused || resumed.Frames[2].Paused {
		t.Errorf("resumed %+v, error %v", resumed, err)
	}
	canceled, err := sequence.Cancel(ctx, s.c, q.ID)
	if err != nil || canceled.State != job.Canceled || canceled.States[job.Canceled] != 3 {
		t.Errorf("canceled %+v, error %v", canceled, err)
	}
	s.check(s.c.Delete(ctx, q.Frames[0].Job))
	if left := s.sequence(q.ID); left.Frames[0].State != job.Deleted || left.State != job.Canceled {
		t.Errorf("without its first frame: %+v", left)
	}
	s.check(sequence.Delete(ctx, s.c, q.ID))
	if _, err := s.c.Sequence(ctx, q.ID); !errors.Is(err, job.ErrNotFound) {
		t.Errorf("after its deletion: %v", err)
	}
	if jobs, _, err := s.c.Jobs(ctx, "", 10); err != nil || len(jobs) != 0 {
		t.Errorf("%d jobs, error %v", len(jobs), err)
	}
}

// TestFramesAreSweptTogether: as long as one frame is young or goes on, none is too old.
func TestFramesAreSweptTogether(t *testing.T) {
	ctx, s := t.Context(), newSite(t)
	s.start()
	defer s.stop()
	q := s.submitFrames(s.frames(2, ""))
	_, err := s.c.Cancel(ctx, q.Frames[0].Job)
	s.check(err)
	jobs := sweep.StoredJobs{Store: s.db, Coordinator: s.c}
	all, err := jobs.Jobs(ctx)
	if err != nil || len(all) != 2 || !all[0].KeptFrom.IsZero() || !all[1].KeptFrom.IsZero() {
		t.Errorf("jobs %+v, error %v", all, err)
	}
	time.Sleep(2 * time.Millisecond)
	last, err := s.c.Cancel(ctx, q.Frames[1].Job)
	s.check(err)
	all, err = jobs.Jobs(ctx)
	if err != nil || len(all) != 2 || !all[0].KeptFrom.Equal(*last.EndedAt) || !all[1].KeptFrom.Equal(*last.EndedAt) {
		t.Errorf("jobs %+v, error %v; the last ended at %v", all, err, last.EndedAt)
	}
}
