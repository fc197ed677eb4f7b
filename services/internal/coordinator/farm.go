package coordinator

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"math"
	"regexp"
	"strings"
	"time"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/bootstrap"
	"metrofarm/services/internal/flow"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/lease"
)

const (
	maxLeaseWait = 30 * time.Second
	// lostPatience bounds what a heartbeat waits for the store: other leases are renewed by it.
	lostPatience = time.Second
	maxSegments  = 4096
	maxNameBytes = 200
	maxActivity  = 200
	maxTaskState = 48 << 20 // chain states in one lease answer, below the message limit
	leaseRecheck = time.Second
)

var instancePattern = regexp.MustCompile(`^[0-9a-f]{32}$`)

// Register introduces a worker. A repeated instance keeps its identity.
func (c *Coordinator) Register(_ context.Context, in *farmv1.RegisterRequest) (*farmv1.RegisterResponse, error) {
	if !instancePattern.MatchString(in.GetInstance()) {
		return nil, &job.FieldError{Field: "instance", Detail: "is not 32 hex digits"}
	}
	if in.GetVersion() == "" || len(in.GetVersion()) > maxNameBytes {
		return nil, &job.FieldError{Field: "version", Detail: "is missing or too long"}
	}
	if in.GetThreads() > maxThreads {
		return nil, &job.FieldError{Field: "threads", Detail: fmt.Sprintf("is more than %d", maxThreads)}
	}
	id, back := c.enlist(in)
	if back {
		c.forgive(id)
	}
	return &farmv1.RegisterResponse{
		WorkerId: id, HeartbeatSeconds: c.options.Heartbeat.Seconds(), CoordinatorId: c.options.Member.ID,
	}, nil
}

// enlist notes a worker, and tells whether it had not been heard of for long.
func (c *Coordinator) enlist(in *farmv1.RegisterRequest) (id string, back bool) {
	c.mu.Lock()
	defer c.mu.Unlock()
	w := c.byInstance(in.GetInstance())
	if w == nil {
		w = &worker{id: workerID(in.GetInstance()), instance: in.GetInstance()}
		c.workers[w.id] = w
	}
	back = c.lost(w)
	w.name, w.version, w.threads = clip(in.GetName(), maxNameBytes), in.GetVersion(), int(in.GetThreads())
	w.lastContact = c.options.Now()
	c.log.Info("worker registered", "worker", w.id, "name", w.name, "version", w.version, "threads", w.threads)
	return w.id, back
}

// workerID is the same at every coordinator that a worker registers with.
func workerID(instance string) string { return "w-" + instance[:12] }

func (c *Coordinator) byInstance(instance string) *worker {
	for _, w := range c.workers {
		if w.instance == instance {
			return w
		}
	}
	return nil
}

func clip(text string, limit int) string {
	if len(text) > limit {
		text = text[:limit]
	}
	return strings.ToValidUTF8(text, "")
}

// Lease grants tasks of the first job in the queue that has any for this worker, waiting for some as
// long as the worker asks.
func (c *Coordinator) Lease(ctx context.Context, in *farmv1.LeaseRequest) (*farmv1.LeaseResponse, error) {
	wait := time.Duration(min(max(in.GetWaitSeconds(), 0), maxLeaseWait.Seconds()) * float64(time.Second))
	deadline := time.NewTimer(wait)
	defer deadline.Stop()
	recheck := time.NewTicker(leaseRecheck) // expired leases announce nothing by themselves
	defer recheck.Stop()
	for {
		changed := c.changes()
		answer, err := c.tryLease(in)
		if err == nil && ctx.Err() != nil { // nobody hears the answer
			c.giveBack(in.GetWorkerId(), refsOf(answer.GetTasks()))
			return nil, ctx.Err()
		}
		if err != nil || len(answer.GetTasks()) > 0 || answer.GetDrain() {
			return answer, err
		}
		select {
		case <-changed:
		case <-recheck.C:
		case <-deadline.C:
			return answer, nil
		case <-c.stopped:
			return answer, nil
		case <-ctx.Done():
			return nil, ctx.Err()
		}
	}
}

func (c *Coordinator) changes() <-chan struct{} {
	c.mu.Lock()
	defer c.mu.Unlock()
	return c.changed
}

func (c *Coordinator) tryLease(in *farmv1.LeaseRequest) (*farmv1.LeaseResponse, error) {
	w, err := c.findWorker(in.GetWorkerId())
	if err != nil {
		return nil, err
	}
	answer := &farmv1.LeaseResponse{TtlSeconds: c.options.LeaseTTL.Seconds(), Drain: w.draining}
	if w.draining {
		return answer, nil
	}
	if w.inQuarantine(c.options.Now()) {
		return answer, nil
	}
	limit := int(min(max(in.GetMaxSegments(), 1), maxSegments))
	grant, copies, withheld := (*run).grant, (*run).grantCopies, c.withholds()
	if withheld {
		grant, copies = (*run).grantWithheld, (*run).grantWithheld
	}
	r, tasks := c.leaseFirst(w, limit, grant, (*run).waits)
	if r == nil {
		now := c.options.Now()
		r, tasks = c.leaseFirst(w, limit, copies, func(r *run) bool { return r.ripens(now) })
	}
	switch {
	case r != nil:
		answer.Tasks, answer.SealSeconds = tasks, r.sealSeconds()
	case withheld && len(c.queue(1, (*run).waits)) > 0:
		c.metrics.withheld.Inc()
	}
	return answer, nil
}

// granter leases tasks of a job to a worker. Requires: mu.
type granter func(r *run, w worker, limit int) []lease.Ref

// leaseFirst grants tasks of the first job that has some, of those that want a worker. Most often that
// is the first of the queue: only if none of the first few has any does it look at all.
func (c *Coordinator) leaseFirst(w worker, limit int, grant granter, wants func(*run) bool) (*run, []*farmv1.Task) {
	const few = 8
	for _, most := range []int{few, math.MaxInt} {
		queue := c.queue(most, wants)
		for _, r := range queue {
			if tasks := r.lease(w, limit, grant); len(tasks) > 0 {
				return r, tasks
			}
		}
		if len(queue) < most {
			break
		}
	}
	return nil, nil
}

// lease grants tasks of this job, none if the worker cannot or need not help.
func (r *run) lease(w worker, limit int, grant granter) []*farmv1.Task {
	r.mu.Lock()
	defer r.mu.Unlock()
	if r.rec.State.Ended() || r.rec.Paused || r.finishing != nil || !r.mayAct() || r.distrusts(w.id) || !r.accepts(w) {
		return nil
	}
	r.expire()
	if r.rec.State.Ended() {
		return nil
	}
	refs := grant(r, w, limit)
	if len(refs) == 0 {
		return nil
	}
	if r.rec.State == job.Queued {
		r.setState(job.Inspecting, "")
		r.save()
	}
	if r.spec != nil {
		r.pin(w.version)
	}
	r.joined(w)
	if again := r.table.LeasedAgain(); again.Tasks > 0 {
		r.note("tasks leased again", append(identity(w), slog.Int("tasks", again.Tasks),
			slog.Float64("seconds_since_last_heard", again.Longest.Seconds()))...)
	}
	tasks := r.buildTasks(refs, w)
	r.c.metrics.granted.Add(float64(len(tasks)))
	return tasks
}

// grant leases waiting tasks; a worker that is in dispute with another gets only what may decide other
// disputes, else workers in dispute could wait for each other. Requires: mu.
func (r *run) grant(w worker, limit int) []lease.Ref {
	now := r.c.options.Now()
	if r.checks.disputes(w.id) {
		return r.table.GrantApart(w.id, limit, now)
	}
	r.table.Linger(2 * (r.sealAfter() - flow.MinSeal))
	return r.table.Grant(w.id, r.share(w, limit), r.eligible(), now)
}

// grantWithheld leases what ends in no batch, and what batches that are held wait for. Requires: mu.
func (r *run) grantWithheld(w worker, limit int) []lease.Ref {
	if r.rec.State != job.Rendering {
		return r.grantCopies(w, limit)
	}
	return r.table.GrantApart(w.id, limit, r.c.options.Now())
}

// grantCopies leases what waits again since leases have run out, or else copies of tasks that straggle.
// Requires: mu.
func (r *run) grantCopies(w worker, limit int) []lease.Ref {
	if granted := r.grant(w, limit); len(granted) > 0 || r.checks.disputes(w.id) {
		return granted
	}
	return r.table.GrantCopies(w.id, limit, r.c.options.Now())
}

// accepts tells whether the worker's version may render this job. Requires: mu.
func (r *run) accepts(w worker) bool {
	pinned := r.spec.GetWorkerVersion()
	if pinned == "" || pinned == w.version {
		return true
	}
	if !r.warned[w.version] {
		r.warned[w.version] = true
		r.publish("warning", fmt.Sprintf("worker %s has version %s, this job is rendered by %s", w.name, w.version, pinned), nil,
			identity(w)...)
		r.save()
	}
	return false
}

// buildTasks turns leases into messages; leases whose chain states would make the answer too long
// are given back. Requires: mu.
func (r *run) buildTasks(refs []lease.Ref, w worker) []*farmv1.Task {
	scene := &scenev1.SceneRef{
		BundleDigest: r.rec.Request.Scene, Entry: r.rec.Request.Entry,
		Defaults: r.rec.Request.Defaults, Lenient: r.rec.Request.Lenient,
	}
	spec := r.stageSpec()
	if spec == nil {
		spec = &jobv1.ResolvedSpec{}
	}
	var tasks []*farmv1.Task
	bytes := 0
	for _, ref := range refs {
		t := &farmv1.Task{TaskId: ref.Task, Epoch: ref.Epoch, JobId: r.id, Scene: scene, Spec: spec}
		key := r.tasks[ref.Task]
		if key.phase == job.Rendering {
			t.Spec = r.state.TaskSpec(key.round)
		}
		r.fillWork(t, key)
		bytes += proto.Size(t)
		if len(tasks) > 0 && bytes > maxTaskState {
			r.table.Release(ref, w.id)
			continue
		}
		tasks = append(tasks, t)
	}
	return tasks
}

// fillWork requires: mu.
func (r *run) fillWork(t *farmv1.Task, key taskKey) {
	switch {
	case key.phase == job.Inspecting:
		t.Work = &farmv1.Task_Inspect{Inspect: &farmv1.InspectTask{}}
	case key.phase == job.Bootstrapping && r.stage == stageTrials:
		t.Work = &farmv1.Task_KernelTrials{KernelTrials: r.trialsTask()}
	case key.phase == job.Bootstrapping:
		t.Work = &farmv1.Task_Bootstrap{Bootstrap: &farmv1.BootstrapTask{
			FirstIndex: key.first.First, Count: key.first.Count, WantsMap: r.mapping(),
		}}
	case r.state.Chains():
		t.Work = &farmv1.Task_Chains{Chains: &farmv1.ChainSegmentsTask{
			Round:  uint32(key.round),
			Groups: []*farmv1.ChainGroupState{r.groupState(key)},

			DirectFirstSample: r.state.DirectBefore(key.round),
		}}
	default:
		t.Work = &farmv1.Task_Paths{Paths: &farmv1.PathSegmentsTask{
			Round: uint32(key.round), FirstSegment: uint32(key.segment), SegmentCount: 1,
			FirstSample: r.state.SamplesBefore(key.round),
		}}
	}
}

func (r *run) groupState(key taskKey) *farmv1.ChainGroupState {
	if key.round > 0 {
		state, _ := r.state.StateBefore(key.round, key.segment)
		return &farmv1.ChainGroupState{Group: uint32(key.segment), State: state}
	}
	return seedState(key.segment, r.state.Seeds[key.segment])
}

// seedState is where the chains of a group start.
func seedState(group int, seeds []bootstrap.Seed) *farmv1.ChainGroupState {
	g := &farmv1.ChainGroupState{Group: uint32(group)}
	for _, seed := range seeds {
		g.SeedIndices = append(g.SeedIndices, seed.Index)
		g.SeedValues = append(g.SeedValues, seed.Value)
	}
	return g
}

// Heartbeat renews leases and tells which to drop.
func (c *Coordinator) Heartbeat(ctx context.Context, in *farmv1.HeartbeatRequest) (*farmv1.HeartbeatResponse, error) {
	w, err := c.findWorker(in.GetWorkerId())
	if err != nil {
		return nil, err
	}
	answer := &farmv1.HeartbeatResponse{Drain: w.draining}
	activity := ""
	var lost []*farmv1.LeaseDirective
	for _, p := range in.GetLeases() {
		d := &farmv1.LeaseDirective{Lease: p.GetLease(), Directive: farmv1.Directive_DIRECTIVE_CONTINUE}
		answer.Directives = append(answer.Directives, d)
		if r := c.runOfTask(p.GetLease().GetTaskId()); r != nil && r.renew(w.id, p) {
			activity = clip(p.GetActivity(), maxActivity)
		} else {
			lost = append(lost, d)
		}
	}
	c.directLost(ctx, lost)
	c.mu.Lock()
	defer c.mu.Unlock()
	if known := c.workers[w.id]; known != nil {
		known.activity = activity
	}
	return answer, nil
}

// directLost tells what to do with leases that are lost. A job between two coordinators still takes what
// is under way of it; one that is over does not.
func (c *Coordinator) directLost(ctx context.Context, lost []*farmv1.LeaseDirective) {
	ctx, cancel := context.WithTimeout(ctx, lostPatience)
	defer cancel()
	over := make(map[string]bool)
	for _, d := range lost {
		id := jobOfTask(d.GetLease().GetTaskId())
		if _, known := over[id]; !known {
			over[id] = c.isOver(ctx, id)
		}
		d.Directive = farmv1.Directive_DIRECTIVE_ABANDON
		if over[id] {
			d.Directive = farmv1.Directive_DIRECTIVE_INTERRUPT
		}
	}
}

// isOver tells whether it is certain that a job has ended or was deleted.
func (c *Coordinator) isOver(ctx context.Context, id string) bool {
	if r := c.running(id); r != nil {
		return r.standing.ended.Load()
	}
	stored, err := c.options.Store.Job(ctx, id)
	return errors.Is(err, job.ErrNotFound) || err == nil && stored.State.Ended()
}

func (r *run) renew(workerID string, p *farmv1.LeaseProgress) bool {
	r.mu.Lock()
	defer r.mu.Unlock()
	fraction := min(max(p.GetFraction(), 0), 1)
	if !r.table.Renew(ref(p.GetLease()), workerID, fraction, r.c.options.Now()) {
		return false
	}
	if r.rec.State != job.Rendering || p.GetActivity() != "" {
		r.activity = clip(p.GetActivity(), maxActivity)
	}
	return true
}

func ref(l *farmv1.LeaseRef) lease.Ref {
	return lease.Ref{Task: l.GetTaskId(), Epoch: l.GetEpoch()}
}

// runOfTask finds the job of a task by its name; nil if there is none.
func (c *Coordinator) runOfTask(task string) *run {
	return c.running(jobOfTask(task))
}

func jobOfTask(task string) string {
	id, _, _ := strings.Cut(task, "/")
	return id
}
