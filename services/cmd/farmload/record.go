package main

import (
	"context"
	"errors"
	"flag"
	"fmt"
	"io"
	"net"
	"sync"

	"google.golang.org/grpc"
	"google.golang.org/grpc/credentials/insecure"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// maxMessage is the coordinator's limit.
const maxMessage = 72 << 20

// recorder is a coordinator for one worker that asks another for everything and keeps the films.
type recorder struct {
	farmv1.UnimplementedFarmServiceServer
	to     farmv1.FarmServiceClient
	wanted int
	done   chan struct{} // closed when there are as many batches as wanted

	mu        sync.Mutex
	recording recording
}

// recorded is what record prints.
type recorded struct {
	Batches []recordedSize `json:"batches"`
}

type recordedSize struct {
	Mutations   uint64  `json:"mutations"`
	Segments    int     `json:"segments"`
	StateBytes  int     `json:"state_bytes_per_segment"`
	Tiles       int     `json:"tiles"`
	PackedBytes int     `json:"packed_bytes"`
	CPUSeconds  float64 `json:"render_cpu_seconds"`
}

func record(ctx context.Context, arguments []string) (any, error) {
	f := flag.NewFlagSet("record", flag.ContinueOnError)
	coordinator := f.String("coordinator", "127.0.0.1:7070", "`ADDRESS` of the coordinator")
	listen := f.String("listen", "127.0.0.1:7071", "`ADDRESS` for the worker")
	out := f.String("out", "", "`FILE` to write")
	batches := f.Int("batches", 8, "keep `N` batches, then end")
	if err := f.Parse(arguments); err != nil {
		return nil, err
	}
	if *out == "" || *batches < 1 {
		return nil, errors.New("-out and at least one of -batches are needed")
	}
	connection, err := dial(*coordinator)
	if err != nil {
		return nil, err
	}
	defer connection.Close()
	r := &recorder{to: farmv1.NewFarmServiceClient(connection), wanted: *batches, done: make(chan struct{})}
	listener, err := (&net.ListenConfig{}).Listen(ctx, "tcp", *listen)
	if err != nil {
		return nil, err
	}
	server := grpc.NewServer(grpc.MaxRecvMsgSize(maxMessage), grpc.MaxSendMsgSize(maxMessage))
	farmv1.RegisterFarmServiceServer(server, r)
	var serving sync.WaitGroup
	serving.Go(func() { _ = server.Serve(listener) })
	select {
	case <-r.done:
	case <-ctx.Done():
	}
	server.Stop()
	serving.Wait()
	if ctx.Err() != nil {
		return nil, ctx.Err()
	}
	return r.sizes(), r.recording.write(*out)
}

func dial(address string, options ...grpc.DialOption) (*grpc.ClientConn, error) {
	options = append(options,
		grpc.WithTransportCredentials(insecure.NewCredentials()),
		grpc.WithDefaultCallOptions(grpc.MaxCallRecvMsgSize(maxMessage), grpc.MaxCallSendMsgSize(maxMessage)))
	connection, err := grpc.NewClient(address, options...)
	if err != nil {
		return nil, fmt.Errorf("connect to %s: %w", address, err)
	}
	return connection, nil
}

func (r *recorder) sizes() recorded {
	var sizes recorded
	for _, b := range r.recording.batches {
		size := recordedSize{Segments: len(b.header.GetSegments()), Tiles: len(b.tiles), CPUSeconds: b.header.GetCpuSeconds()}
		for _, s := range b.header.GetSegments() {
			size.Mutations += s.GetCounts().GetMutations()
			size.StateBytes = max(size.StateBytes, len(s.GetState()))
		}
		size.PackedBytes = packedBytes(b.tiles)
		sizes.Batches = append(sizes.Batches, size)
	}
	return sizes
}

func packedBytes(tiles []*farmv1.Tile) (n int) {
	for _, t := range tiles {
		n += len(t.GetData())
	}
	return n
}

// Register implements FarmService.
func (r *recorder) Register(ctx context.Context, in *farmv1.RegisterRequest) (*farmv1.RegisterResponse, error) {
	return r.to.Register(ctx, in)
}

// Lease implements FarmService.
func (r *recorder) Lease(ctx context.Context, in *farmv1.LeaseRequest) (*farmv1.LeaseResponse, error) {
	out, err := r.to.Lease(ctx, in)
	for _, t := range out.GetTasks() {
		if t.GetChains() != nil || t.GetPaths() != nil {
			r.mu.Lock()
			r.recording.spec = t.GetSpec()
			r.mu.Unlock()
		}
	}
	return out, err
}

// Heartbeat implements FarmService.
func (r *recorder) Heartbeat(ctx context.Context, in *farmv1.HeartbeatRequest) (*farmv1.HeartbeatResponse, error) {
	return r.to.Heartbeat(ctx, in)
}

// Report implements FarmService.
func (r *recorder) Report(ctx context.Context, in *farmv1.ReportRequest) (*farmv1.ReportResponse, error) {
	return r.to.Report(ctx, in)
}

// Release implements FarmService.
func (r *recorder) Release(ctx context.Context, in *farmv1.ReleaseRequest) (*farmv1.ReleaseResponse, error) {
	return r.to.Release(ctx, in)
}

// FetchBundle implements FarmService.
func (r *recorder) FetchBundle(in *farmv1.FetchBundleRequest, stream grpc.ServerStreamingServer[farmv1.FetchBundleResponse]) error {
	from, err := r.to.FetchBundle(stream.Context(), in)
	for err == nil {
		var part *farmv1.FetchBundleResponse
		if part, err = from.Recv(); err == nil {
			err = stream.Send(part)
		}
	}
	if errors.Is(err, io.EOF) {
		return nil
	}
	return err
}

// Deliver implements FarmService.
func (r *recorder) Deliver(stream grpc.ClientStreamingServer[farmv1.DeliverRequest, farmv1.DeliverResponse]) error {
	to, err := r.to.Deliver(stream.Context())
	if err != nil {
		return err
	}
	var batch recording
	for {
		message, err := stream.Recv()
		if errors.Is(err, io.EOF) {
			break
		}
		if err != nil {
			return err
		}
		batch.add(message)
		if to.Send(message) != nil {
			break // CloseAndRecv has the reason
		}
	}
	answer, err := to.CloseAndRecv()
	if err != nil {
		return err
	}
	r.keep(batch)
	return stream.SendAndClose(answer)
}

func (r *recorder) keep(batch recording) {
	r.mu.Lock()
	defer r.mu.Unlock()
	if len(r.recording.batches) == r.wanted {
		return
	}
	r.recording.batches = append(r.recording.batches, batch.batches...)
	if len(r.recording.batches) == r.wanted {
		close(r.done)
	}
}
