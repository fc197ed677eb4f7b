package sequence_test

import (
	"context"
	"errors"
	"fmt"
	"slices"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/sequence"
	"metrofarm/services/internal/store"
)

// service has a sequence of frames whose jobs fail with these errors.
type service struct {
	sequence.Service
	errors  []error
	touched []string
}

func (s *service) Sequence(context.Context, string) (job.Sequence, error) {
	var q job.Sequence
	for i := range s.errors {
		q.Frames = append(q.Frames, job.Frame{Number: i, Job: fmt.Sprint(i), State: job.Rendering})
	}
	return q, nil
}

func (s *service) Pause(_ context.Context, id string) (job.Snapshot, error) {
	s.touched = append(s.touched, id)
	return job.Snapshot{}, s.errors[slices.Index([]string{"0", "1", "2"}, id)]
}

func TestAFrameThatIsNotAvailableKeepsNoneOfTheOthersWaiting(t *testing.T) {
	s := &service{errors: []error{nil, job.ErrUnavailable, job.ErrUnavailable}}
	_, err := sequence.Pause(t.Context(), s, "q")
	if !errors.Is(err, job.ErrUnavailable) || !strings.HasPrefix(err.Error(), "frame 2: ") {
		t.Errorf("error %v, want that of the first frame that was tried", err)
	}
	if !slices.Equal(s.touched, []string{"2", "1", "0"}) {
		t.Errorf("tried frames %q", s.touched)
	}
}

func TestOtherErrorsEndAnAction(t *testing.T) {
	broken := errors.New("broken")
	s := &service{errors: []error{nil, broken, job.ErrConflict}}
	if _, err := sequence.Pause(t.Context(), s, "q"); !errors.Is(err, broken) {
		t.Errorf("error %v", err)
	}
	if !slices.Equal(s.touched, []string{"2", "1"}) {
		t.Errorf("tried frames %q", s.touched)
	}
}

func TestAnOutageOfTheStoreIsWaitedForOnce(t *testing.T) {
	s := &service{errors: []error{nil, nil, fmt.Errorf("job 2: %w", store.ErrUnavailable)}}
	if _, err := sequence.Pause(t.Context(), s, "q"); !errors.Is(err, store.ErrUnavailable) {
		t.Errorf("error %v", err)
	}
	if !slices.Equal(s.touched, []string{"2"}) {
		t.Errorf("tried frames %q", s.touched)
	}
}
