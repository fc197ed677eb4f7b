package peer

import (
	"cmp"
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"net/http"
	"net/url"
	"slices"
	"strconv"
	"sync"
	"time"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

const (
	// askTimeout bounds what one list waits for other coordinators.
	askTimeout = 2 * time.Second
	// pageLength is the most that one may ask for.
	pageLength = 200
	// maxAnswer of another coordinator.
	maxAnswer = 64 << 20
)

// Jobs implements api.Service. The owners say how their jobs are; where one does not answer, a job is
// shown as it was last stored.
func (f *Farm) Jobs(ctx context.Context, cursor string, limit int) ([]job.Snapshot, string, error) {
	if alone(ctx) {
		return pageOf(f.Own(), cursor, limit)
	}
	jobs, next, err := f.Coordinator.Jobs(ctx, cursor, limit)
	if err != nil {
		return nil, "", err
	}
	owners, err := f.ownersOf(ctx, jobs)
	if err != nil {
		return nil, "", err
	}
	live := make(map[string]job.Snapshot)
	for _, answer := range ask(ctx, f, owners, f.jobsOf) {
		for _, j := range answer {
			live[j.ID] = j
		}
	}
	for i := range jobs {
		if j, found := live[jobs[i].ID]; found && jobs[i].Owner != "" {
			jobs[i] = j
		}
	}
	return jobs, next, nil
}

// Live implements api.Service. The jobs of a coordinator that does not answer are missing.
func (f *Farm) Live(ctx context.Context) ([]job.Snapshot, error) {
	jobs := f.Own()
	peers, err := f.Peers(ctx)
	if err != nil {
		return nil, err
	}
	for _, answer := range ask(ctx, f, peers, f.jobsOf) {
		jobs = append(jobs, answer...)
	}
	return jobs, nil
}

// ownersOf jobs, but this coordinator.
func (f *Farm) ownersOf(ctx context.Context, jobs []job.Snapshot) ([]store.Member, error) {
	urls := make(map[string]bool)
	for _, j := range jobs {
		if j.Owner != "" {
			urls[j.Owner] = true
		}
	}
	return f.at(ctx, urls)
}

// at lists the other coordinators that have one of these URLs.
func (f *Farm) at(ctx context.Context, urls map[string]bool) ([]store.Member, error) {
	if len(urls) == 0 {
		return nil, nil
	}
	peers, err := f.Peers(ctx)
	return slices.DeleteFunc(peers, func(m store.Member) bool { return !urls[m.REST] }), err
}

func pageOf(jobs []job.Snapshot, cursor string, limit int) (page []job.Snapshot, next string, err error) {
	if cursor != "" {
		at := slices.IndexFunc(jobs, func(j job.Snapshot) bool { return j.ID == cursor })
		if at < 0 {
			return nil, "", &job.FieldError{Field: "cursor", Detail: "names no job of this coordinator"}
		}
		jobs = jobs[at+1:]
	}
	if len(jobs) > limit {
		jobs = jobs[:limit]
		next = jobs[limit-1].ID
	}
	return jobs, next, nil
}

// jobsOf asks a coordinator for the jobs that it owns. With an error come those of the pages before.
func (f *Farm) jobsOf(ctx context.Context, peer store.Member) (jobs []job.Snapshot, err error) {
	for cursor, more := "", true; more; more = cursor != "" {
		var page struct {
			Jobs []job.Snapshot `json:"jobs"`
			Next string         `json:"next"`
		}
		query := url.Values{"limit": {strconv.Itoa(pageLength)}}
		if cursor != "" {
			query.Set("cursor", cursor)
		}
		if err := f.call(ctx, http.MethodGet, peer, "/v1/jobs?"+query.Encode(), &page); err != nil {
			return jobs, err
		}
		jobs, cursor = append(jobs, page.Jobs...), page.Next
	}
	return jobs, nil
}

// Workers implements api.Service. A worker that leases from several coordinators is shown once.
func (f *Farm) Workers(ctx context.Context) ([]job.Worker, error) {
	workers, err := f.Coordinator.Workers(ctx)
	if err != nil || alone(ctx) {
		return workers, err
	}
	peers, err := f.Peers(ctx)
	if err != nil {
		return nil, err
	}
	for _, answer := range ask(ctx, f, peers, f.workersOf) {
		workers = append(workers, answer...)
	}
	return joinWorkers(workers), nil
}

func (f *Farm) workersOf(ctx context.Context, peer store.Member) ([]job.Worker, error) {
	var answer struct {
		Workers []job.Worker `json:"workers"`
	}
	err := f.call(ctx, http.MethodGet, peer, "/v1/workers", &answer)
	return answer.Workers, err
}

// Drain implements api.Service. Every coordinator that knows the worker must drain it.
func (f *Farm) Drain(ctx context.Context, id string) (job.Worker, error) {
	own, err := f.Coordinator.Drain(ctx, id)
	if alone(ctx) || err != nil && !errors.Is(err, job.ErrNotFound) {
		return own, err
	}
	var drained []job.Worker
	if err == nil {
		drained = append(drained, own)
	}
	peers, err := f.Peers(ctx)
	if err != nil {
		return job.Worker{}, err
	}
	for _, peer := range peers {
		var w job.Worker
		err := f.call(ctx, http.MethodPost, peer, "/v1/workers/"+url.PathEscape(id)+"/drain", &w)
		switch {
		case errors.Is(err, job.ErrNotFound):
		case err != nil:
			return job.Worker{}, fmt.Errorf("drain worker %s: %w: %w", id, job.ErrUnavailable, err)
		default:
			drained = append(drained, w)
		}
	}
	if len(drained) == 0 {
		return job.Worker{}, fmt.Errorf("worker %q: %w", id, job.ErrNotFound)
	}
	return joinWorkers(drained)[0], nil
}

// stateRank orders what coordinators say of one worker; the highest holds.
var stateRank = map[string]int{"lost": 0, "idle": 1, "busy": 2, "quarantined": 3, "draining": 4}

func joinWorkers(workers []job.Worker) []job.Worker {
	joined := make([]job.Worker, 0, len(workers))
	at := make(map[string]int)
	for _, w := range workers {
		i, known := at[w.ID]
		if !known {
			at[w.ID] = len(joined)
			joined = append(joined, w)
			continue
		}
		j := &joined[i]
		if stateRank[w.State] > stateRank[j.State] {
			j.State = w.State
		}
		if w.LastContact.After(j.LastContact) {
			j.LastContact = w.LastContact
		}
		j.LeasedSegments += w.LeasedSegments
		j.MutationsPerSecond += w.MutationsPerSecond
		j.Conflicts += w.Conflicts
		j.Activity, j.Exclusion = cmp.Or(j.Activity, w.Activity), cmp.Or(j.Exclusion, w.Exclusion)
	}
	slices.SortFunc(joined, func(a, b job.Worker) int {
		return cmp.Or(cmp.Compare(a.Name, b.Name), cmp.Compare(a.ID, b.ID))
	})
	return joined
}

// ask asks peers at the same time and returns what those that answered said.
func ask[T any](ctx context.Context, f *Farm, peers []store.Member, question func(context.Context, store.Member) ([]T, error)) [][]T {
	ctx, cancel := context.WithTimeout(ctx, askTimeout)
	defer cancel()
	answers := make([][]T, len(peers))
	var wait sync.WaitGroup
	for i, peer := range peers {
		wait.Go(func() {
			var err error
			if answers[i], err = question(ctx, peer); err != nil {
				f.log.WarnContext(ctx, "a coordinator does not answer", "peer", peer.REST, "error", err)
			}
		})
	}
	wait.Wait()
	return answers
}

// call asks one coordinator for what it alone knows.
func (f *Farm) call(ctx context.Context, method string, peer store.Member, path string, into any) error {
	ctx, cancel := context.WithTimeout(ctx, askTimeout)
	defer cancel()
	request, err := http.NewRequestWithContext(ctx, method, peer.REST+path, nil)
	if err != nil {
		return err
	}
	if caller, known := ctx.Value(callerKey{}).(http.Header); known {
		request.Header = caller.Clone()
	}
	request.Header.Set(forwardedHeader, marked(peer.Secret))
	response, err := f.client.Do(request)
	if err != nil {
		return err
	}
	defer response.Body.Close()
	switch response.StatusCode {
	case http.StatusOK:
		return json.NewDecoder(io.LimitReader(response.Body, maxAnswer)).Decode(into)
	case http.StatusNoContent:
		return nil
	case http.StatusNotFound:
		return job.ErrNotFound
	case http.StatusConflict:
		return job.ErrConflict
	default:
		return fmt.Errorf("%s answers %s", peer.REST, response.Status)
	}
}
