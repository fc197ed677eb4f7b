package api

import (
	"context"
	"net/http"

	"github.com/danielgtaylor/huma/v2"
)

type healthOutput struct {
	Body struct {
		Status string `json:"status"`
	}
}

func (s *server) registerHealth(api huma.API) {
	huma.Register(api, huma.Operation{
		OperationID: "get-health", Method: http.MethodGet, Path: "/healthz", Tags: []string{"operation"},
		Summary: "The process answers", Security: openToAll(),
	}, func(context.Context, *struct{}) (*healthOutput, error) { return healthy(), nil })
	huma.Register(api, huma.Operation{
		OperationID: "get-readiness", Method: http.MethodGet, Path: "/readyz", Tags: []string{"operation"},
		Summary: "The coordinator can take requests", Security: openToAll(),
	}, s.ready)
}

func healthy() *healthOutput {
	output := &healthOutput{}
	output.Body.Status = "ok"
	return output
}

func (s *server) ready(ctx context.Context, _ *struct{}) (*healthOutput, error) {
	if s.Ready != nil {
		if err := s.Ready(ctx); err != nil {
			return nil, huma.Error503ServiceUnavailable(err.Error())
		}
	}
	return healthy(), nil
}
