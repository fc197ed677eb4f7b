package main

import (
	"context"
	"slices"
	"sync"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// calls notes how long the workers' calls take and what becomes of their batches.
type calls struct {
	mu       sync.Mutex
	since    time.Time
	took     map[string][]time.Duration
	outcomes map[string]int
	failures map[string]int // by method and code
	packed   int            // bytes of tiles in batches that were answered
}

func newCalls() *calls {
	c := &calls{}
	c.reset()
	return c
}

// reset forgets what was so far.
func (c *calls) reset() {
	c.mu.Lock()
	defer c.mu.Unlock()
	c.since, c.packed = time.Now(), 0
	c.took, c.outcomes, c.failures = map[string][]time.Duration{}, map[string]int{}, map[string]int{}
}

// note a call. Those that end because the test ends do not count.
func (c *calls) note(ctx context.Context, method string, start time.Time, err error) {
	if err != nil && ctx.Err() != nil {
		return
	}
	c.mu.Lock()
	defer c.mu.Unlock()
	if err != nil {
		c.failures[method+": "+status.Code(err).String()]++
		return
	}
	c.took[method] = append(c.took[method], time.Since(start))
}

// unary is a grpc.UnaryClientInterceptor. A lease call without tasks has waited for work: it says
// nothing about the coordinator.
func (c *calls) unary(ctx context.Context, method string, in, out any, connection *grpc.ClientConn, invoke grpc.UnaryInvoker, options ...grpc.CallOption) error {
	start := time.Now()
	err := invoke(ctx, method, in, out, connection, options...)
	if lease, ok := out.(*farmv1.LeaseResponse); ok && err == nil && len(lease.GetTasks()) == 0 {
		method += " without tasks"
	}
	c.note(ctx, method, start, err)
	return err
}

// stream is a grpc.StreamClientInterceptor.
func (c *calls) stream(ctx context.Context, desc *grpc.StreamDesc, connection *grpc.ClientConn, method string, streamer grpc.Streamer, options ...grpc.CallOption) (grpc.ClientStream, error) {
	start := time.Now()
	inner, err := streamer(ctx, desc, connection, method, options...)
	if err != nil {
		c.note(ctx, method, start, err)
		return nil, err
	}
	return &delivery{ClientStream: inner, calls: c, method: method, start: start}, nil
}

// delivery is one stream of a batch.
type delivery struct {
	grpc.ClientStream
	calls  *calls
	method string
	start  time.Time
	packed int
}

// SendMsg implements grpc.ClientStream.
func (d *delivery) SendMsg(message any) error {
	if part, ok := message.(*farmv1.DeliverRequest); ok {
		d.packed += packedBytes(part.GetTiles().GetTiles())
	}
	return d.ClientStream.SendMsg(message)
}

// RecvMsg implements grpc.ClientStream.
func (d *delivery) RecvMsg(message any) error {
	err := d.ClientStream.RecvMsg(message)
	d.calls.note(d.Context(), d.method, d.start, err)
	if answer, ok := message.(*farmv1.DeliverResponse); ok && err == nil {
		d.calls.mu.Lock()
		defer d.calls.mu.Unlock()
		d.calls.outcomes[answer.GetOutcome().String()]++
		d.calls.packed += d.packed
	}
	return err
}

// latency of a method's calls, in seconds.
type latency struct {
	Calls   int     `json:"calls"`
	P50     float64 `json:"p50"`
	P99     float64 `json:"p99"`
	Longest float64 `json:"longest"`
}

// traffic is what the calls came to.
type traffic struct {
	Seconds     float64            `json:"seconds"`
	Batches     map[string]int     `json:"batches"`
	PackedBytes int                `json:"packed_bytes"`
	Latency     map[string]latency `json:"latency_seconds"`
	Failures    map[string]int     `json:"failures"`
}

func (c *calls) summary() traffic {
	c.mu.Lock()
	defer c.mu.Unlock()
	t := traffic{
		Seconds: time.Since(c.since).Seconds(), Batches: c.outcomes, PackedBytes: c.packed,
		Latency: map[string]latency{}, Failures: c.failures,
	}
	for method, took := range c.took {
		slices.Sort(took)
		at := func(share float64) float64 { return took[int(share*float64(len(took)-1))].Seconds() }
		t.Latency[method[len(servicePrefix):]] = latency{len(took), at(0.5), at(0.99), at(1)}
	}
	return t
}

// servicePrefix of the methods' names.
const servicePrefix = "/metrofarm.farm.v1.FarmService/"
