package job_test

import (
	"testing"

	"metrofarm/services/internal/job"
)

func TestWantedWorkersFollowsWholeRounds(t *testing.T) {
	for _, c := range []struct {
		snapshot job.Snapshot
		want     int
	}{
		{job.Snapshot{State: job.Queued}, 1},
		{job.Snapshot{State: job.Queued, WaitingForMemory: true}, 0},
		{job.Snapshot{State: job.Rendering, RoundSegments: 16, RoundSegmentsDone: 15}, 1},
		{job.Snapshot{State: job.Rendering, RoundSegments: 17}, 2},
		{job.Snapshot{State: job.Rendering, RoundSegments: 160, RoundSegmentsDone: 159}, 10},
		{job.Snapshot{State: job.Rendering, RoundSegments: 160, Paused: true}, 0},
		{job.Snapshot{State: job.Done, RoundSegments: 160}, 0},
	} {
		if got := c.snapshot.WantedWorkers(); got != c.want {
			t.Errorf("%+v wants %d workers, not %d", c.snapshot, got, c.want)
		}
	}
}
