package coordinator_test

import (
	"context"
	"errors"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// as is the context of a user's requests.
func as(t *testing.T, user string) context.Context {
	t.Helper()
	token, line, err := auth.NewToken(auth.Submit, user)
	if err != nil {
		t.Fatal(err)
	}
	path := filepath.Join(t.TempDir(), "tokens")
	if err := os.WriteFile(path, []byte(line), 0o600); err != nil {
		t.Fatal(err)
	}
	tokens, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	identity, _ := tokens.Find(token)
	return auth.With(t.Context(), identity)
}

// trySubmit submits a job that nobody renders.
func (s *site) trySubmit(ctx context.Context) (string, error) {
	s.t.Helper()
	request := pathRequest(4)
	request.Scene, request.Entry = s.bundle(), "scene.xml"
	submitted, err := s.c.Submit(ctx, request, "")
	return submitted.ID, err
}

// expectTooMany checks that there is no room for what was asked, and that the answer says so.
func (s *site) expectTooMany(err error, says string) {
	s.t.Helper()
	if !errors.Is(err, job.ErrTooMany) || !strings.Contains(err.Error(), says) {
		s.t.Errorf("error %v, want too many jobs with %q", err, says)
	}
}

func TestJobsThatHaveNotEndedAreBounded(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.MaxJobs = 3 }
	s.start()
	defer func() { s.stop() }()
	first, err := s.trySubmit(t.Context())
	s.check(err)
	s.submitFrames(s.frames(2, "")) // frames count
	_, err = s.trySubmit(t.Context())
	s.expectTooMany(err, "3 of all users have not ended, and with 1 more there would be over 3")
	_, err = s.c.SubmitSequence(t.Context(), s.frames(2, ""), "")
	s.expectTooMany(err, "with 2 more there would be over 3")
	var wrong *job.FieldError
	if _, err = s.c.SubmitSequence(t.Context(), s.frames(4, ""), ""); !errors.As(err, &wrong) || wrong.Field != "frames.end" {
		t.Errorf("a sequence that is too long at any time: %v", err)
	}
	s.stop()
	s.start() // they count whoever took them
	s.await(first, "taken over", func(j job.Snapshot) bool { return !j.Stale })
	if _, err := s.c.Cancel(t.Context(), first); err != nil {
		t.Fatal(err)
	}
	s.check(s.eventually(func() error { _, err := s.trySubmit(t.Context()); return err }))
}

// eventually repeats an attempt until it succeeds.
func (s *site) eventually(attempt func() error) error {
	for deadline := time.Now().Add(patience); ; time.Sleep(2 * time.Millisecond) {
		if err := attempt(); err == nil || time.Now().After(deadline) {
			return err
		}
	}
}

func TestJobsOfOneUserAreBounded(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.MaxJobs, o.MaxUserJobs = 3, 2 }
	s.start()
	defer s.stop()
	alice, bob := as(t, "alice"), as(t, "bob")
	for range 2 {
		_, err := s.trySubmit(alice)
		s.check(err)
	}
	_, err := s.trySubmit(alice)
	s.expectTooMany(err, "2 of alice have not ended")
	_, err = s.trySubmit(bob)
	s.check(err)
	_, err = s.trySubmit(bob)
	s.expectTooMany(err, "3 of all users have not ended")
}

func TestRefinedJobsCountAgain(t *testing.T) {
	s := newSite(t)
	s.tune = func(o *coordinator.Options) { o.MaxJobs = 1 }
	s.start()
	defer s.stop()
	dismiss := s.crew(workers(1, nil)...)
	done := s.submit(pathRequest(4))
	s.finished(done)
	dismiss()
	waiting, err := s.trySubmit(t.Context())
	s.check(err)
	_, err = s.c.Refine(t.Context(), done, job.StopRules{SamplesPerPixel: 8})
	s.expectTooMany(err, "1 of all users")
	_, err = s.c.Cancel(t.Context(), waiting)
	s.check(err)
	s.check(s.eventually(func() error {
		_, err := s.c.Refine(t.Context(), done, job.StopRules{SamplesPerPixel: 8})
		return err
	}))
}

func TestJobsOfOtherCoordinatorsCount(t *testing.T) {
	p := newPair(t, 300*time.Millisecond)
	for _, s := range p.sites {
		named := s.tune
		s.tune = func(o *coordinator.Options) { named(o); o.MaxJobs = 2 }
		s.start()
		defer s.stop()
	}
	first, second := p.sites[0], p.sites[1]
	for range 2 {
		_, err := first.trySubmit(t.Context())
		first.check(err)
	}
	members := func() int {
		list, err := p.store.Members(t.Context())
		first.check(err)
		return list[0].Jobs[""] + list[1].Jobs[""]
	}
	p.eventually("told of", func() bool { return members() == 2 })
	p.eventually("heard of", func() bool { // by the beat after that; what is accepted before is canceled again
		id, err := second.trySubmit(t.Context())
		if err == nil {
			_, err := second.c.Cancel(t.Context(), id)
			second.check(err)
			return false
		}
		second.expectTooMany(err, "2 of all users")
		return true
	})
}
