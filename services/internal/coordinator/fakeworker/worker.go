// Package fakeworker is a worker for tests: it speaks the protocol for real and renders pseudo-
// random splats that depend only on what a real segment depends on. A Fault makes it misbehave.
package fakeworker

import (
	"context"
	"encoding/hex"
	"fmt"
	"slices"
	"time"

	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"
	"google.golang.org/protobuf/proto"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	workv1 "metrofarm/services/gen/metrofarm/work/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/plan"
)

// Fault is one way to misbehave with a batch.
type Fault int

// The faults.
const (
	None      Fault = iota
	Vanish          // never deliver, come back as a new process
	Repeat          // deliver twice
	Stale           // deliver after the lease has run out
	BitFlip         // change a value, keep the digests
	Truncated       // announce more tiles than follow
	Forged          // change a value and the header's digest
	Abandoned       // break the stream off
)

// Worker is one worker process.
type Worker struct {
	Client  workv1.FarmServiceClient
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
	// Delay before each batch is delivered.
	Delay time.Duration

	id       string
	instance int
	codec    *film.Codec
}

// Run works until ctx ends. Transport errors are retried, as real workers do.
func (w *Worker) Run(ctx context.Context) error {
	codec, err := film.NewCodec()
	if err != nil {
		return err
	}
	w.codec = codec
	for ctx.Err() == nil {
		err := w.step(ctx)
		switch status.Code(err) {
		case codes.OK:
		case codes.NotFound:
			w.id = ""
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
	answer, err := w.Client.Lease(ctx, &workv1.LeaseRequest{
		WorkerId: w.id, MaxSegments: max(w.MaxSegments, 4), WaitSeconds: 0.2,
	})
	if err != nil || len(answer.GetTasks()) == 0 {
		return err
	}
	if answer.GetTasks()[0].GetChains() != nil || answer.GetTasks()[0].GetPaths() != nil {
		return w.renderAll(ctx, answer.GetTasks())
	}
	for _, task := range answer.GetTasks() {
		if err := w.report(ctx, task); err != nil {
			return err
		}
	}
	return nil
}

func (w *Worker) register(ctx context.Context) error {
	instance := make([]byte, 16)
	copy(instance, fmt.Sprintf("%04d%s", w.instance, w.Name))
	answer, err := w.Client.Register(ctx, &workv1.RegisterRequest{
		Name: w.Name, Version: w.Version, Threads: 1, Instance: hex.EncodeToString(instance),
	})
	w.id = answer.GetWorkerId()
	return err
}

func (w *Worker) report(ctx context.Context, task *workv1.Task) error {
	request := &workv1.ReportRequest{
		WorkerId: w.id, Lease: &workv1.LeaseRef{TaskId: task.GetTaskId(), Epoch: task.GetEpoch()},
	}
	switch work := task.GetWork().(type) {
	case *workv1.Task_Inspect:
		request.Result = &workv1.ReportRequest_Scene{Scene: w.Report}
	case *workv1.Task_Bootstrap:
		request.Result = &workv1.ReportRequest_Bootstrap{Bootstrap: w.bootstrap(task, work.Bootstrap)}
	}
	_, err := w.Client.Report(ctx, request)
	return err
}

func (w *Worker) bootstrap(task *workv1.Task, part *workv1.BootstrapTask) *workv1.BootstrapResult {
	result := &workv1.BootstrapResult{FirstIndex: part.GetFirstIndex(), Rays: uint64(part.GetCount())}
	spec := task.GetSpec()
	for i := range uint64(part.GetCount()) {
		index := part.GetFirstIndex() + i
		value := BootstrapValue(spec.GetSeed(), index)
		if w.Black || w.OneHalf && index < spec.GetBootstrapSamples()/2 {
			value = 0
		}
		result.Values = append(result.Values, value)
	}
	return result
}

// renderAll renders tasks into one batch per round and delivers them, latest round first: order
// must not matter.
func (w *Worker) renderAll(ctx context.Context, tasks []*workv1.Task) error {
	byRound := map[uint32][]*workv1.Task{}
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
			return w.fail(ctx, byRound[number][0], err)
		}
		sleep(ctx, w.Delay)
		if err := w.deliver(ctx, header, tiles); err != nil {
			return err
		}
	}
	return nil
}

func (w *Worker) fail(ctx context.Context, task *workv1.Task, cause error) error {
	_, err := w.Client.Report(ctx, &workv1.ReportRequest{
		WorkerId: w.id, Lease: &workv1.LeaseRef{TaskId: task.GetTaskId(), Epoch: task.GetEpoch()},
		Result: &workv1.ReportRequest_Failure{Failure: &workv1.TaskFailure{
			Reason: workv1.FailureReason_FAILURE_REASON_REPLAY, Message: cause.Error(),
		}},
	})
	return err
}

func (w *Worker) render(number uint32, tasks []*workv1.Task) (*workv1.BatchHeader, []*workv1.Tile, error) {
	spec := tasks[0].GetSpec()
	c := newCanvas(spec)
	header := &workv1.BatchHeader{JobId: tasks[0].GetJobId(), Round: number, CpuSeconds: 0.01}
	for _, t := range tasks {
		var result *workv1.SegmentResult
		if chains := t.GetChains(); chains != nil {
			g := chains.GetGroups()[0]
			for i, index := range g.GetSeedIndices() {
				if want := BootstrapValue(spec.GetSeed(), index); g.GetSeedValues()[i] != want {
					return nil, nil, fmt.Errorf("seed %d has %v, not %v", index, g.GetSeedValues()[i], want)
				}
			}
			result = c.renderChains(spec, number, g)
		} else {
			result = c.renderPaths(spec, plan.Cells(spec, w.Report), number, t.GetPaths().GetFirstSegment())
		}
		result.Lease = &workv1.LeaseRef{TaskId: t.GetTaskId(), Epoch: t.GetEpoch()}
		header.Segments = append(header.Segments, result)
		header.Digest += result.GetDigest()
	}
	var tiles []*workv1.Tile
	for address, values := range c.tiles {
		tiles = append(tiles, w.codec.EncodeTile(address, values))
	}
	header.TileCount = uint32(len(tiles))
	return header, tiles, nil
}

func (w *Worker) deliver(ctx context.Context, header *workv1.BatchHeader, tiles []*workv1.Tile) error {
	fault := None
	if w.Fault != nil {
		fault = w.Fault()
	}
	switch fault {
	case Vanish:
		w.id = ""
		w.instance++
		return nil
	case Repeat:
		if _, err := w.Send(ctx, header, tiles); err != nil {
			return err
		}
	case Stale:
		sleep(ctx, w.StaleDelay)
	case BitFlip, Forged:
		header, tiles = w.damage(header, tiles, fault)
	case Truncated:
		tiles = tiles[1:]
	case Abandoned:
		return w.breakOff(ctx, header, tiles)
	}
	_, err := w.Send(ctx, header, tiles)
	return err
}

// damage replaces one tile by another content.
func (w *Worker) damage(header *workv1.BatchHeader, tiles []*workv1.Tile, fault Fault) (*workv1.BatchHeader, []*workv1.Tile) {
	shape := film.Shape{Width: int(w.Report.GetWidth()), Height: int(w.Report.GetHeight()), Layers: 1}
	values := make([]int64, film.FullTileValues)
	values[0] = 12345
	changed := slices.Clone(tiles)
	for i, t := range changed {
		if !t.GetLow() && t.GetPlane() == 0 && t.GetX() == 0 && t.GetY() == 0 {
			changed[i] = w.codec.EncodeTile(film.Address{}, values)
		}
	}
	header = proto.CloneOf(header)
	if fault == Forged {
		header.Digest = shape.SplatDigest(false, 0, 0, 0, values[0])
	}
	header.TileCount = uint32(len(changed))
	return header, changed
}

// Send delivers a batch.
func (w *Worker) Send(ctx context.Context, header *workv1.BatchHeader, tiles []*workv1.Tile) (*workv1.DeliverResponse, error) {
	stream, err := w.Client.Deliver(ctx)
	if err != nil {
		return nil, err
	}
	opening := &workv1.DeliverHeader{WorkerId: w.id, Batch: header}
	if err := stream.Send(&workv1.DeliverRequest{Content: &workv1.DeliverRequest_Header{Header: opening}}); err != nil {
		_, err = stream.CloseAndRecv()
		return nil, err
	}
	for part := range slices.Chunk(tiles, 5) {
		message := &workv1.DeliverRequest{Content: &workv1.DeliverRequest_Tiles{Tiles: &workv1.DeliverTiles{Tiles: part}}}
		if stream.Send(message) != nil {
			break // CloseAndRecv has the reason
		}
	}
	return stream.CloseAndRecv()
}

func (w *Worker) breakOff(ctx context.Context, header *workv1.BatchHeader, tiles []*workv1.Tile) error {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	stream, err := w.Client.Deliver(ctx)
	if err != nil {
		return err
	}
	opening := &workv1.DeliverHeader{WorkerId: w.id, Batch: header}
	_ = stream.Send(&workv1.DeliverRequest{Content: &workv1.DeliverRequest_Header{Header: opening}})
	_ = stream.Send(&workv1.DeliverRequest{Content: &workv1.DeliverRequest_Tiles{Tiles: &workv1.DeliverTiles{Tiles: tiles[:1]}}})
	return nil
}
