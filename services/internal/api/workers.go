package api

import (
	"context"
	"net/http"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/job"
)

type workersOutput struct {
	Body struct {
		Workers []job.Worker `json:"workers"`
	}
}

type workerPath struct {
	ID string `path:"id" maxLength:"128" doc:"The worker."`
}

type workerOutput struct {
	Body job.Worker
}

// Autoscale is what a scaler of worker pods reads.
type Autoscale struct {
	DesiredWorkers int `json:"desired_workers" doc:"How many workers the jobs that can run now could use."`
	ActiveJobs     int `json:"active_jobs" doc:"Jobs that have not ended and are not paused."`
	Workers        int `json:"workers" doc:"Workers that are connected and not draining."`
}

type autoscaleOutput struct {
	Body Autoscale
}

func (s *server) registerWorkers(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "list-workers", Method: http.MethodGet, Path: "/v1/workers", Tags: []string{"workers"},
		Summary: "List the workers that have been seen",
	}, s.workers)
	huma.Register(api, huma.Operation{
		OperationID: "drain-worker", Method: http.MethodPost, Path: "/v1/workers/{id}/drain", Tags: []string{"workers"},
		Summary: "Ask a worker to finish what it holds and leave",
	}, s.drain)
	huma.Register(api, huma.Operation{
		OperationID: "get-autoscale", Method: http.MethodGet, Path: "/v1/autoscale", Tags: []string{"workers"},
		Summary: "How many workers could be busy",
	}, s.autoscale)
}

func (s *server) workers(ctx context.Context, _ *struct{}) (*workersOutput, error) {
	workers, err := s.Service.Workers(ctx)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	output := &workersOutput{}
	output.Body.Workers = append([]job.Worker{}, workers...)
	return output, nil
}

func (s *server) drain(ctx context.Context, input *workerPath) (*workerOutput, error) {
	worker, err := s.Service.Drain(ctx, input.ID)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	return &workerOutput{Body: worker}, nil
}

func (s *server) autoscale(ctx context.Context, _ *struct{}) (*autoscaleOutput, error) {
	output := &autoscaleOutput{}
	for cursor, more := "", true; more; more = cursor != "" {
		jobs, next, err := s.Service.Jobs(ctx, cursor, maxListLength)
		if err != nil {
			return nil, s.fail(ctx, err)
		}
		for _, snapshot := range jobs {
			if wanted := wantedWorkers(snapshot); wanted > 0 {
				output.Body.ActiveJobs++
				output.Body.DesiredWorkers += wanted
			}
		}
		cursor = next
	}
	workers, err := s.Service.Workers(ctx)
	if err != nil {
		return nil, s.fail(ctx, err)
	}
	for _, worker := range workers {
		if worker.State == "idle" || worker.State == "busy" {
			output.Body.Workers++
		}
	}
	return output, nil
}

// segmentsPerWorker is how much of a round keeps one worker busy long enough to be worth a start.
const segmentsPerWorker = 16

// wantedWorkers of one job: none when it cannot run, else one per so many segments of a whole
// round. What is left of the round would make the number fall to one at each round's end.
func wantedWorkers(snapshot job.Snapshot) int {
	if snapshot.State.Ended() || snapshot.Paused {
		return 0
	}
	return max(1, (snapshot.RoundSegments+segmentsPerWorker-1)/segmentsPerWorker)
}
