// Package fakeworker is a worker for tests: it speaks the protocol for real and renders pseudo-
// random splats that depend only on what a real segment depends on. A Fault makes it misbehave.
package fakeworker

import (
	"cmp"
	"context"
	"crypto/sha256"
	"encoding/hex"
	"errors"
	"fmt"
	"slices"
	"sync"
	"time"

	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"

	"metrofarm/services/checksum"
	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/plan"
)

// Worker is one worker process.
type Worker struct {
	Client  farmv1.FarmServiceClient
	Name    string
	Version string
	// Report is what inspections find.
	Report *scenev1.SceneReport
	// MaxSegments per lease; 0 means 4.
	MaxSegments uint32
	// Fault chooses what to do with the next batch; nil means always None.
	Fault func() Fault
	// StaleDelay is how long Stale waits.
	StaleDelay time.Duration
	// Black makes all bootstrap values zero; OneHalf only those of half 1.
	Black, OneHalf bool
	// OneBounce leaves nothing where direct light is apart.
	OneBounce bool
	// Sparks leaves nearly all light to very few bootstrap values.
	Sparks bool
	// Trapped chains: two in round 0 that have not moved for 4000 mutations, one of which moves in
	// round 1.
	Trapped bool
	// Lie is added to a value of every segment, with digests that fit: 0 is honest.
	Lie int64
	// Glare multiplies f where large steps of chains report it, unless it is 0.
	Glare float64
	// Rendered is told of each batch before it is delivered; nil: nobody is.
	Rendered func(*farmv1.BatchHeader, []*farmv1.Tile)
	// Seal: collect over leases for as long as the coordinator says.
	Seal bool
	// Delay before each batch is delivered.
	Delay time.Duration
	// Pace of heartbeats and Wait of lease calls; 0 means what suits tests with short leases.
	Pace, Wait time.Duration
	// Leaves tells to give back what is held when Run ends, as workers do that are told to end; else
	// they vanish, which speaks against the tasks they held.
	Leaves bool
	// CPUSeconds that it reports for each batch; 0 means 0.01.
	CPUSeconds float64
	// StateBytes of each chain group; at least 8.
	StateBytes int
	// Film makes the tiles of a batch that has this digest, in place of those that were splatted.
	Film func(digest uint64) []*farmv1.Tile

	instance  int
	codec     *film.Codec
	collected []*farmv1.Task
	since     time.Time // of the first of them

	mu   sync.Mutex // guards what the heartbeats read
	id   string
	held []*farmv1.LeaseProgress
}

// heartbeatPace is well below the time to live that tests use.
const (
	heartbeatPace = 50 * time.Millisecond
	leaseWait     = 200 * time.Millisecond
)

// beat sends heartbeats until ctx ends.
func (w *Worker) beat(ctx context.Context) {
	for ctx.Err() == nil {
		w.mu.Lock()
		request := &farmv1.HeartbeatRequest{WorkerId: w.id, Leases: w.held}
		w.mu.Unlock()
		if request.GetWorkerId() != "" {
			_, _ = w.Client.Heartbeat(ctx, request) // the next call notices what is wrong
		}
		sleep(ctx, cmp.Or(w.Pace, heartbeatPace))
	}
}

func (w *Worker) become(id string) {
	w.mu.Lock()
	defer w.mu.Unlock()
	w.id, w.held = id, nil
}

func (w *Worker) hold(tasks []*farmv1.Task) {
	w.mu.Lock()
	defer w.mu.Unlock()
	w.held = nil
	for _, t := range tasks {
		w.held = append(w.held, &farmv1.LeaseProgress{Lease: &farmv1.LeaseRef{TaskId: t.GetTaskId(), Epoch: t.GetEpoch()}})
	}
}

// errDrained: the coordinator does not want this worker any more.
var errDrained = errors.New("drained")

// Run works until ctx ends or the coordinator drains the worker. Transport errors are retried, as real workers do.
func (w *Worker) Run(ctx context.Context) error {
	codec, err := film.NewCodec()
	if err != nil {
		return err
	}
	w.codec = codec
	ctx, cancel := context.WithCancel(ctx)
	var beating sync.WaitGroup
	beating.Go(func() { w.beat(ctx) })
	defer w.leave(ctx)
	defer beating.Wait()
	defer cancel()
	for ctx.Err() == nil {
		err := w.step(ctx)
		if errors.Is(err, errDrained) {
			return nil
		}
		switch status.Code(err) {
		case codes.OK:
		case codes.NotFound:
			w.become("")
		case codes.Unavailable, codes.Canceled, codes.DeadlineExceeded:
			sleep(ctx, 5*time.Millisecond)
		default:
			if ctx.Err() == nil {
				return fmt.Errorf("worker %s: %w", w.Name, err)
			}
		}
	}
	return nil
}

// leavePatience bounds the last call of a worker.
const leavePatience = 5 * time.Second

func (w *Worker) leave(ctx context.Context) {
	if !w.Leaves || w.id == "" {
		return
	}
	ctx, cancel := context.WithTimeout(context.WithoutCancel(ctx), leavePatience)
	defer cancel()
	// Should it fail, the leases run out.
	_, _ = w.Client.Release(ctx, &farmv1.ReleaseRequest{WorkerId: w.id, Leaving: true})
}

func sleep(ctx context.Context, d time.Duration) {
	select {
	case <-ctx.Done():
	case <-time.After(d):
	}
}

func (w *Worker) step(ctx context.Context) error {
	if w.id == "" {
		if err := w.register(ctx); err != nil {
			return err
		}
	}
	wait := cmp.Or(w.Wait, leaseWait)
	if len(w.collected) > 0 {
		wait = 0
	}
	answer, err := w.Client.Lease(ctx, &farmv1.LeaseRequest{
		WorkerId: w.id, MaxSegments: max(w.MaxSegments, 4), WaitSeconds: wait.Seconds(),
	})
	if err == nil && answer.GetDrain() {
		return errDrained
	}
	if err != nil || len(answer.GetTasks()) == 0 {
		return errors.Join(err, w.seal(ctx))
	}
	if answer.GetTasks()[0].GetChains() != nil || answer.GetTasks()[0].GetPaths() != nil {
		return w.collect(ctx, answer)
	}
	if err := w.seal(ctx); err != nil {
		return err
	}
	w.hold(answer.GetTasks())
	defer w.hold(nil)
	for _, task := range answer.GetTasks() {
		if err := w.report(ctx, task); err != nil {
			return err
		}
	}
	return nil
}

// collect renders tasks, unless more are to be collected before.
func (w *Worker) collect(ctx context.Context, answer *farmv1.LeaseResponse) error {
	if len(w.collected) > 0 && w.collected[0].GetJobId() != answer.GetTasks()[0].GetJobId() {
		if err := w.seal(ctx); err != nil {
			return err
		}
	}
	if len(w.collected) == 0 {
		w.since = time.Now()
	}
	w.collected = append(w.collected, answer.GetTasks()...)
	w.hold(w.collected)
	if w.Seal && time.Since(w.since).Seconds() < answer.GetSealSeconds() {
		return nil
	}
	return w.seal(ctx)
}

// seal renders and delivers what is collected.
func (w *Worker) seal(ctx context.Context) error {
	tasks := w.collected
	w.collected = nil
	defer w.hold(nil)
	return w.renderAll(ctx, tasks)
}

func (w *Worker) register(ctx context.Context) error {
	instance := sha256.Sum256(fmt.Appendf(nil, "%d %s", w.instance, w.Name))
	answer, err := w.Client.Register(ctx, &farmv1.RegisterRequest{
		Name: w.Name, Version: w.Version, Threads: 1, Instance: hex.EncodeToString(instance[:16]),
	})
	w.become(answer.GetWorkerId())
	return err
}

func (w *Worker) report(ctx context.Context, task *farmv1.Task) error {
	request := &farmv1.ReportRequest{
		WorkerId: w.id, Lease: &farmv1.LeaseRef{TaskId: task.GetTaskId(), Epoch: task.GetEpoch()},
	}
	switch work := task.GetWork().(type) {
	case *farmv1.Task_Inspect:
		request.Result = &farmv1.ReportRequest_Scene{Scene: w.Report}
	case *farmv1.Task_Bootstrap:
		request.Result = &farmv1.ReportRequest_Bootstrap{Bootstrap: w.bootstrap(task, work.Bootstrap)}
	case *farmv1.Task_KernelTrials:
		request.Result = &farmv1.ReportRequest_KernelTrials{KernelTrials: tryKernels(work.KernelTrials)}
	}
	return w.sendReport(ctx, request)
}

func (w *Worker) sendReport(ctx context.Context, request *farmv1.ReportRequest) error {
	request.Checksum = checksum.Of(request)
	_, err := w.Client.Report(ctx, request)
	return err
}

func (w *Worker) bootstrap(task *farmv1.Task, part *farmv1.BootstrapTask) *farmv1.BootstrapResult {
	result := &farmv1.BootstrapResult{FirstIndex: part.GetFirstIndex(), Rays: uint64(part.GetCount())}
	spec := task.GetSpec()
	for i := range uint64(part.GetCount()) {
		result.Values = append(result.Values, w.value(spec, part.GetFirstIndex()+i))
	}
	if part.GetWantsMap() && spec.GetDirectSizes() == nil {
		result.Map = make([]float64, plan.MapSide*plan.MapSide)
		for i, v := range result.GetValues() {
			result.Map[i%len(result.Map)] += float64(v)
		}
	}
	return result
}

// tryKernels accepts half of the steps of 0.01 and more of smaller ones.
func tryKernels(work *farmv1.KernelTrialsTask) *farmv1.KernelTrialsResult {
	result := &farmv1.KernelTrialsResult{}
	n := work.GetMutations() * uint64(len(work.GetGroup().GetSeedIndices()))
	for _, k := range work.GetKernels() {
		accepted := float64(n) * 0.01 / (0.01 + k.GetS2())
		result.Trials = append(result.Trials, &farmv1.SegmentCounts{
			Mutations: n, SmallSteps: n, SmallAccepted: uint64(accepted), PathEvaluations: n, Rays: n,
		})
	}
	return result
}

// value of a bootstrap index as this worker sees it.
func (w *Worker) value(spec *jobv1.ResolvedSpec, index uint64) float32 {
	const spark, dim = 0.995, 1e-6
	value := BootstrapValue(spec.GetSeed(), index)
	switch {
	case w.OneBounce && spec.GetDirectSizes() != nil, w.Black || w.OneHalf && index < spec.GetBootstrapSamples()/2:
		return 0
	case w.Sparks && value < spark:
		return value * dim
	}
	return value
}

// renderAll renders tasks into one batch per round and delivers them, latest round first: order
// must not matter.
func (w *Worker) renderAll(ctx context.Context, tasks []*farmv1.Task) error {
	byRound := map[uint32][]*farmv1.Task{}
	for _, t := range tasks {
		number := max(t.GetChains().GetRound(), t.GetPaths().GetRound())
		byRound[number] = append(byRound[number], t)
	}
	rounds := make([]uint32, 0, len(byRound))
	for number := range byRound {
		rounds = append(rounds, number)
	}
	slices.Sort(rounds)
	slices.Reverse(rounds)
	for _, number := range rounds {
		header, tiles, err := w.render(number, byRound[number])
		if err != nil {
			first := byRound[number][0]
			return w.fail(ctx, &farmv1.LeaseRef{TaskId: first.GetTaskId(), Epoch: first.GetEpoch()}, err)
		}
		if w.Rendered != nil {
			w.Rendered(header, tiles)
		}
		sleep(ctx, w.Delay)
		if err := w.deliver(ctx, header, tiles); err != nil {
			return err
		}
	}
	return nil
}

func (w *Worker) fail(ctx context.Context, lease *farmv1.LeaseRef, cause error) error {
	return w.sendReport(ctx, &farmv1.ReportRequest{
		WorkerId: w.id, Lease: lease,
		Result: &farmv1.ReportRequest_Failure{Failure: &farmv1.TaskFailure{
			Reason: farmv1.FailureReason_FAILURE_REASON_REPLAY, Message: cause.Error(),
		}},
	})
}

func (w *Worker) render(number uint32, tasks []*farmv1.Task) (*farmv1.BatchHeader, []*farmv1.Tile, error) {
	spec := tasks[0].GetSpec()
	c := newCanvas(spec)
	if w.Film != nil {
		c.tiles = nil
	}
	header := &farmv1.BatchHeader{JobId: tasks[0].GetJobId(), Round: number, CpuSeconds: cmp.Or(w.CPUSeconds, 0.01)}
	for _, t := range tasks {
		var result *farmv1.SegmentResult
		if chains := t.GetChains(); chains != nil {
			g := chains.GetGroups()[0]
			for i, index := range g.GetSeedIndices() {
				if want := w.value(spec, index); g.GetSeedValues()[i] != want {
					return nil, nil, fmt.Errorf("seed %d has %v, not %v", index, g.GetSeedValues()[i], want)
				}
			}
			if plan.Multiplexed(spec) && len(spec.GetLengthProbabilities()) != int(spec.GetMaxDepth()) {
				return nil, nil, fmt.Errorf("%d probabilities of lengths for paths of %d edges",
					len(spec.GetLengthProbabilities()), spec.GetMaxDepth())
			}
			result = c.renderChains(spec, number, g)
			result.State = append(result.State, make([]byte, max(w.StateBytes, len(result.State))-len(result.State))...)
			if w.Trapped {
				trap(result, number)
			}
		} else {
			result = c.renderPaths(spec, plan.Cells(spec, w.Report), t.GetPaths())
		}
		if w.Glare != 0 {
			for _, sums := range result.GetLargeStepSums() {
				sums.Sum, sums.SumSquares = w.Glare*sums.GetSum(), w.Glare*w.Glare*sums.GetSumSquares()
			}
		}
		if w.Lie != 0 {
			result.Digest += c.add(0, 0, 0, 0, 0, w.Lie)
		}
		result.Lease = &farmv1.LeaseRef{TaskId: t.GetTaskId(), Epoch: t.GetEpoch()}
		result.Checksum = checksum.Of(result)
		header.Segments = append(header.Segments, result)
		header.Digest += result.GetDigest()
	}
	tiles := w.pack(c, header.GetDigest())
	header.TileCount = uint32(len(tiles))
	return header, tiles, nil
}

// pack encodes what was splatted, or makes a film of the same digest.
func (w *Worker) pack(c *canvas, digest uint64) []*farmv1.Tile {
	if w.Film != nil {
		return w.Film(digest)
	}
	var tiles []*farmv1.Tile
	for address, values := range c.tiles {
		tiles = append(tiles, w.codec.EncodeTile(address, values))
	}
	return tiles
}
