package api

import (
	"context"
	"net/http"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
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
	DesiredWorkers int `json:"desired_workers" doc:"How many workers the jobs could use: for each that has not ended, is not paused and does not wait for memory one, and one for every 16 segments of a whole round."`
	ActiveJobs     int `json:"active_jobs" doc:"Jobs that have not ended, are not paused and do not wait for memory."`
	Workers        int `json:"workers" doc:"Workers that are connected and neither draining nor in quarantine."`
}

type autoscaleOutput struct {
	Body Autoscale
}

func (s *server) registerWorkers(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "list-workers", Method: http.MethodGet, Path: "/v1/workers", Tags: []string{"workers"},
		Summary: "List the workers that have been seen", Security: needs(auth.Read),
	}, s.workers)
	huma.Register(api, huma.Operation{
		OperationID: "drain-worker", Method: http.MethodPost, Path: "/v1/workers/{id}/drain", Tags: []string{"workers"},
		Summary: "Ask a worker to finish what it holds and leave", Security: needs(auth.Admin),
	}, s.drain)
	huma.Register(api, huma.Operation{
		OperationID: "get-autoscale", Method: http.MethodGet, Path: "/v1/autoscale", Tags: []string{"workers"},
		Summary: "How many workers could be busy", Security: needs(auth.Read),
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
			if wanted := snapshot.WantedWorkers(); wanted > 0 {
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
