package api

import (
	"context"
	"encoding/json"
	"errors"
	"log/slog"
	"net/http"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/job"
)

// fail turns an error of the coordinator into the problem document that the client gets. What went
// wrong inside is logged, not sent.
func (s *server) fail(ctx context.Context, err error) error {
	status := statusOf(err)
	if status == http.StatusInternalServerError {
		s.logger.ErrorContext(ctx, "request failed", slog.Any("error", err))
		return huma.NewError(status, "the coordinator failed; its log says why")
	}
	var field *job.FieldError
	if errors.As(err, &field) {
		return huma.NewError(status, err.Error(),
			&huma.ErrorDetail{Message: field.Detail, Location: "body." + field.Field})
	}
	var entry *bundle.EntryError
	if errors.As(err, &entry) {
		return huma.NewError(status, err.Error(),
			&huma.ErrorDetail{Message: entry.Detail, Location: "body", Value: entry.Entry})
	}
	if errors.Is(err, bundle.ErrTooLarge) {
		return huma.NewError(status, err.Error(), &huma.ErrorDetail{Message: err.Error(), Location: "body"})
	}
	problem := huma.NewError(status, err.Error())
	if status == http.StatusServiceUnavailable || status == http.StatusTooManyRequests {
		return huma.ErrorWithHeaders(problem, http.Header{"Retry-After": {retrySeconds}})
	}
	return problem
}

// statusOf is the one place that maps errors to HTTP statuses.
func statusOf(err error) int {
	switch {
	case errors.Is(err, errSlow): // first: to whoever unpacks the upload it is a damaged one
		return http.StatusRequestTimeout
	case errors.Is(err, job.ErrNotFound):
		return http.StatusNotFound
	case errors.Is(err, job.ErrConflict), errors.Is(err, job.ErrNoImage), errors.Is(err, job.ErrNoReport):
		return http.StatusConflict
	case errors.Is(err, job.ErrTooMany):
		return http.StatusTooManyRequests
	case errors.Is(err, bundle.ErrTooLarge):
		return http.StatusRequestEntityTooLarge
	case errors.Is(err, job.ErrInvalid):
		return http.StatusUnprocessableEntity
	case errors.Is(err, job.ErrUnavailable):
		return http.StatusServiceUnavailable
	case errors.Is(err, context.Canceled):
		return http.StatusServiceUnavailable // the client left or we are stopping
	default:
		return http.StatusInternalServerError
	}
}

// writeProblem answers with a problem document outside of huma's operations.
func writeProblem(w http.ResponseWriter, status int, detail string) {
	w.Header().Set("Content-Type", "application/problem+json")
	w.WriteHeader(status)
	// A client that has left is not our problem.
	_ = json.NewEncoder(w).Encode(huma.ErrorModel{
		Title: http.StatusText(status), Status: status, Detail: detail,
	})
}
