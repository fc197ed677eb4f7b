// Package client speaks to a coordinator over REST.
package client

import (
	"bytes"
	"context"
	"crypto/tls"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"net/http"
	"net/url"
	"strconv"
	"strings"

	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/job"
)

// Client of one coordinator. Its methods may be called from several goroutines.
type Client struct {
	base  string // without a slash at its end
	token string
	http  *http.Client
}

// Options of a client; the zero value has neither token nor TLS of its own.
type Options struct {
	// Token that requests bring; empty: none.
	Token string
	// TLS trusts the server; nil: what this machine trusts.
	TLS *tls.Config
}

// New makes a client of the coordinator at server, for example "http://127.0.0.1:8080".
func New(server string, options Options) (*Client, error) {
	base, err := url.Parse(server)
	if err != nil {
		return nil, fmt.Errorf("server %q: %w", server, err)
	}
	if (base.Scheme != "http" && base.Scheme != "https") || base.Host == "" {
		return nil, fmt.Errorf("server %q: want http://HOST:PORT or https://HOST:PORT", server)
	}
	transport := http.DefaultTransport.(*http.Transport).Clone()
	if options.TLS != nil {
		transport.TLSClientConfig = options.TLS
	}
	return &Client{
		base: strings.TrimSuffix(base.String(), "/"), token: options.Token,
		http: &http.Client{CheckRedirect: stay, Transport: transport},
	}, nil
}

// stay makes redirections errors: the interface has none, and a body could not be sent twice.
func stay(*http.Request, []*http.Request) error { return http.ErrUseLastResponse }

// Problem is an error that the coordinator answered.
type Problem struct {
	Status int    `json:"status"`
	Title  string `json:"title"`
	Detail string `json:"detail"`
	Errors []struct {
		Message  string `json:"message"`
		Location string `json:"location"`
	} `json:"errors"`
}

func (p *Problem) Error() string {
	var text strings.Builder
	text.WriteString(p.Detail)
	if p.Detail == "" {
		fmt.Fprintf(&text, "the server answered %d %s", p.Status, p.Title)
	}
	for _, e := range p.Errors {
		if !strings.Contains(p.Detail, e.Message) {
			fmt.Fprintf(&text, "; %s: %s", e.Location, e.Message)
		}
	}
	return text.String()
}

// Is makes problems comparable with the errors of package job.
func (p *Problem) Is(target error) bool {
	return (p.Status == http.StatusNotFound && target == job.ErrNotFound) ||
		(p.Status == http.StatusConflict && target == job.ErrConflict)
}

// do sends a request; the caller closes the answer's body.
func (c *Client) do(ctx context.Context, method, path string, body io.Reader, header http.Header) (*http.Response, error) {
	request, err := http.NewRequestWithContext(ctx, method, c.base+path, body)
	if err != nil {
		return nil, err
	}
	for name, values := range header {
		request.Header[name] = values
	}
	if c.token != "" {
		request.Header.Set("Authorization", "Bearer "+c.token)
	}
	response, err := c.http.Do(request)
	if err != nil {
		return nil, err
	}
	if response.StatusCode < http.StatusMultipleChoices {
		return response, nil
	}
	defer response.Body.Close()
	return nil, problemOf(response)
}

const problemLimit = 1 << 20

func problemOf(response *http.Response) error {
	problem := &Problem{Status: response.StatusCode, Title: http.StatusText(response.StatusCode)}
	content, err := io.ReadAll(io.LimitReader(response.Body, problemLimit))
	if err != nil {
		return fmt.Errorf("reading an error answer: %w", err)
	}
	// Without a problem document (a proxy in between) the status has to do.
	_ = json.Unmarshal(content, problem)
	return problem
}

// call sends a request and decodes its JSON answer.
func call[T any](ctx context.Context, c *Client, method, path string, body io.Reader, header http.Header) (T, error) {
	var value T
	response, err := c.do(ctx, method, path, body, header)
	if err != nil {
		return value, err
	}
	defer response.Body.Close()
	if err := json.NewDecoder(response.Body).Decode(&value); err != nil {
		return value, fmt.Errorf("answer to %s %s: %w", method, path, err)
	}
	return value, nil
}

func jobPath(id string, rest ...string) string {
	return "/v1/jobs/" + url.PathEscape(id) + strings.Join(rest, "")
}

// Upload sends an archive and returns the stored bundle.
func (c *Client) Upload(ctx context.Context, archive io.Reader) (bundle.Scene, error) {
	header := http.Header{"Content-Type": {"application/octet-stream"}}
	return call[bundle.Scene](ctx, c, http.MethodPost, "/v1/scenes", archive, header)
}

// Submit submits a job.
func (c *Client) Submit(ctx context.Context, request job.Request, idempotencyKey string) (job.Snapshot, error) {
	body, err := json.Marshal(request)
	if err != nil {
		return job.Snapshot{}, err
	}
	header := http.Header{"Content-Type": {"application/json"}}
	if idempotencyKey != "" {
		header.Set("Idempotency-Key", idempotencyKey)
	}
	return call[job.Snapshot](ctx, c, http.MethodPost, "/v1/jobs", bytes.NewReader(body), header)
}

// Job returns one job.
func (c *Client) Job(ctx context.Context, id string) (job.Snapshot, error) {
	return call[job.Snapshot](ctx, c, http.MethodGet, jobPath(id), nil, nil)
}

// Jobs lists up to limit jobs, newest first; 0: all.
func (c *Client) Jobs(ctx context.Context, limit int) ([]job.Snapshot, error) {
	return pages(limit, func(query url.Values) ([]job.Snapshot, string, error) {
		page, err := call[struct {
			Jobs []job.Snapshot `json:"jobs"`
			Next string         `json:"next"`
		}](ctx, c, http.MethodGet, "/v1/jobs?"+query.Encode(), nil, nil)
		return page.Jobs, page.Next, err
	})
}

// Act does one of cancel, pause, resume and finish.
func (c *Client) Act(ctx context.Context, id, action string) (job.Snapshot, error) {
	return call[job.Snapshot](ctx, c, http.MethodPost, jobPath(id, "/", action), nil, nil)
}

// Change changes the name or the priority of a job: those that patch, a JSON merge patch, has.
func (c *Client) Change(ctx context.Context, id string, patch map[string]any) (job.Snapshot, error) {
	body, err := json.Marshal(patch)
	if err != nil {
		return job.Snapshot{}, err
	}
	header := http.Header{"Content-Type": {"application/merge-patch+json"}}
	return call[job.Snapshot](ctx, c, http.MethodPatch, jobPath(id), bytes.NewReader(body), header)
}

// Refine lets a job that has ended go on until these rules end it.
func (c *Client) Refine(ctx context.Context, id string, stop job.StopRules) (job.Snapshot, error) {
	body, err := json.Marshal(stop)
	if err != nil {
		return job.Snapshot{}, err
	}
	header := http.Header{"Content-Type": {"application/json"}}
	return call[job.Snapshot](ctx, c, http.MethodPost, jobPath(id, "/refine"), bytes.NewReader(body), header)
}

// Log copies a job's log, from after that record on, to w: lines of text, or of JSON.
func (c *Client) Log(ctx context.Context, id string, after uint64, format string, w io.Writer) error {
	query := url.Values{"after": {strconv.FormatUint(after, 10)}, "format": {format}}
	return c.Download(ctx, id, "log?"+query.Encode(), w)
}

// Cancel ends a job.
func (c *Client) Cancel(ctx context.Context, id string) (job.Snapshot, error) {
	return c.Act(ctx, id, "cancel")
}

// Finish makes the round under way the last.
func (c *Client) Finish(ctx context.Context, id string) (job.Snapshot, error) {
	return c.Act(ctx, id, "finish")
}

// Workers lists the workers.
func (c *Client) Workers(ctx context.Context) ([]job.Worker, error) {
	answer, err := call[struct {
		Workers []job.Worker `json:"workers"`
	}](ctx, c, http.MethodGet, "/v1/workers", nil, nil)
	return answer.Workers, err
}

// Drain asks a worker to finish what it holds and leave.
func (c *Client) Drain(ctx context.Context, id string) (job.Worker, error) {
	return call[job.Worker](ctx, c, http.MethodPost, "/v1/workers/"+url.PathEscape(id)+"/drain", nil, nil)
}

// Download copies an image ("image.exr?precision=half", "image.png") to w.
func (c *Client) Download(ctx context.Context, id, image string, w io.Writer) error {
	response, err := c.do(ctx, http.MethodGet, jobPath(id, "/", image), nil, nil)
	if err != nil {
		return err
	}
	defer response.Body.Close()
	if _, err := io.Copy(w, response.Body); err != nil {
		return fmt.Errorf("downloading %s: %w", image, err)
	}
	return nil
}

var errNoStream = errors.New("the server's answer is no event stream")
