package client

import (
	"bytes"
	"context"
	"encoding/json"
	"net/http"
	"net/url"
	"strconv"
	"strings"

	"metrofarm/services/internal/job"
)

func sequencePath(id string, rest ...string) string {
	return "/v1/sequences/" + url.PathEscape(id) + strings.Join(rest, "")
}

// SubmitSequence submits a sequence.
func (c *Client) SubmitSequence(ctx context.Context, request job.SequenceRequest, idempotencyKey string) (job.Sequence, error) {
	body, err := json.Marshal(request)
	if err != nil {
		return job.Sequence{}, err
	}
	header := http.Header{"Content-Type": {"application/json"}}
	if idempotencyKey != "" {
		header.Set("Idempotency-Key", idempotencyKey)
	}
	return call[job.Sequence](ctx, c, http.MethodPost, "/v1/sequences", bytes.NewReader(body), header)
}

// Sequence returns one sequence with its frames.
func (c *Client) Sequence(ctx context.Context, id string) (job.Sequence, error) {
	return call[job.Sequence](ctx, c, http.MethodGet, sequencePath(id), nil, nil)
}

// Sequences lists up to limit sequences, newest first and without their frames; 0: all.
func (c *Client) Sequences(ctx context.Context, limit int) ([]job.Sequence, error) {
	return pages(limit, func(query url.Values) ([]job.Sequence, string, error) {
		page, err := call[struct {
			Sequences []job.Sequence `json:"sequences"`
			Next      string         `json:"next"`
		}](ctx, c, http.MethodGet, "/v1/sequences?"+query.Encode(), nil, nil)
		return page.Sequences, page.Next, err
	})
}

// pages asks for a list page by page, until there are limit entries; 0: all.
func pages[T any](limit int, ask func(query url.Values) (page []T, next string, err error)) ([]T, error) {
	const pageSize = 200
	all := []T{}
	for cursor := ""; ; {
		query := url.Values{"limit": {strconv.Itoa(pageSize)}}
		if limit > 0 {
			query.Set("limit", strconv.Itoa(min(pageSize, limit-len(all))))
		}
		if cursor != "" {
			query.Set("cursor", cursor)
		}
		page, next, err := ask(query)
		if err != nil {
			return nil, err
		}
		all = append(all, page...)
		if cursor = next; cursor == "" || (limit > 0 && len(all) >= limit) {
			return all, nil
		}
	}
}

// ActOnSequence does one of cancel, pause and resume to the frames that have not ended.
func (c *Client) ActOnSequence(ctx context.Context, id, action string) (job.Sequence, error) {
	return call[job.Sequence](ctx, c, http.MethodPost, sequencePath(id, "/", action), nil, nil)
}
