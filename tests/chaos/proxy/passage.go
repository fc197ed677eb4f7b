package main

import (
	"context"
	"errors"
	"io"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/backoff"
	"google.golang.org/grpc/credentials/insecure"
	"google.golang.org/grpc/keepalive"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

const maxMessage = 72 << 20

func serverOptions() []grpc.ServerOption {
	return []grpc.ServerOption{
		grpc.MaxRecvMsgSize(maxMessage), grpc.MaxSendMsgSize(maxMessage),
		grpc.KeepaliveEnforcementPolicy(keepalive.EnforcementPolicy{MinTime: time.Second, PermitWithoutStream: true}),
	}
}

// dial connects to a coordinator, and soon again to one that comes back.
func dial(upstream string) (*grpc.ClientConn, error) {
	pace := backoff.Config{BaseDelay: 50 * time.Millisecond, Multiplier: 1.5, MaxDelay: 500 * time.Millisecond}
	return grpc.NewClient(upstream, grpc.WithTransportCredentials(insecure.NewCredentials()),
		grpc.WithDefaultCallOptions(grpc.MaxCallRecvMsgSize(maxMessage), grpc.MaxCallSendMsgSize(maxMessage)),
		grpc.WithConnectParams(grpc.ConnectParams{Backoff: pace, MinConnectTimeout: time.Second}))
}

// passage is the way to one coordinator. What it does not disturb it passes on as it is, errors too.
type passage struct {
	farmv1.UnimplementedFarmServiceServer
	disturber *disturber
	name      string
	upstream  farmv1.FarmServiceClient
}

func newPassage(d *disturber, name string, upstream farmv1.FarmServiceClient) *passage {
	return &passage{disturber: d, name: name, upstream: upstream}
}

// Register implements FarmService.
func (p *passage) Register(ctx context.Context, in *farmv1.RegisterRequest) (*farmv1.RegisterResponse, error) {
	return p.upstream.Register(ctx, in)
}

// Lease implements FarmService.
func (p *passage) Lease(ctx context.Context, in *farmv1.LeaseRequest) (*farmv1.LeaseResponse, error) {
	return p.upstream.Lease(ctx, in)
}

// Release implements FarmService.
func (p *passage) Release(ctx context.Context, in *farmv1.ReleaseRequest) (*farmv1.ReleaseResponse, error) {
	return p.upstream.Release(ctx, in)
}

// FetchBundle implements FarmService.
func (p *passage) FetchBundle(in *farmv1.FetchBundleRequest, out grpc.ServerStreamingServer[farmv1.FetchBundleResponse]) error {
	stream, err := p.upstream.FetchBundle(out.Context(), in)
	if err != nil {
		return err
	}
	for {
		piece, err := stream.Recv()
		if errors.Is(err, io.EOF) {
			return nil
		}
		if err != nil {
			return err
		}
		if err := out.Send(piece); err != nil {
			return err
		}
	}
}

// Heartbeat keeps quiet about leases that are to run out.
func (p *passage) Heartbeat(ctx context.Context, in *farmv1.HeartbeatRequest) (*farmv1.HeartbeatResponse, error) {
	shown := &farmv1.HeartbeatRequest{WorkerId: in.GetWorkerId()}
	var hidden []*farmv1.LeaseDirective
	for _, l := range in.GetLeases() {
		if p.disturber.hidden.has(l.GetLease()) {
			hidden = append(hidden, &farmv1.LeaseDirective{Lease: l.GetLease(), Directive: farmv1.Directive_DIRECTIVE_CONTINUE})
			continue
		}
		shown.Leases = append(shown.Leases, l)
	}
	answer, err := p.upstream.Heartbeat(ctx, shown)
	if err == nil {
		answer.Directives = append(answer.Directives, hidden...)
	}
	return answer, err
}

// Report implements FarmService.
func (p *passage) Report(ctx context.Context, in *farmv1.ReportRequest) (*farmv1.ReportResponse, error) {
	return p.disturber.report(ctx, p, in)
}

// Deliver takes a delivery in to its end before it goes on.
func (p *passage) Deliver(in grpc.ClientStreamingServer[farmv1.DeliverRequest, farmv1.DeliverResponse]) error {
	var parcel parcel
	for {
		message, err := in.Recv()
		if errors.Is(err, io.EOF) {
			break
		}
		if err != nil {
			return err
		}
		if header := message.GetHeader(); header != nil {
			parcel.header = header
		}
		if tiles := message.GetTiles(); tiles != nil {
			parcel.tiles = append(parcel.tiles, tiles)
		}
	}
	answer, err := p.disturber.deliver(in.Context(), p, parcel)
	if err != nil {
		return err
	}
	return in.SendAndClose(answer)
}

// send delivers a parcel.
func (p *passage) send(ctx context.Context, x parcel) (*farmv1.DeliverResponse, error) {
	stream, err := p.upstream.Deliver(ctx)
	if err != nil {
		return nil, err
	}
	if stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: x.header}}) == nil {
		for _, tiles := range x.tiles {
			if stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Tiles{Tiles: tiles}}) != nil {
				break // CloseAndRecv has the reason
			}
		}
	}
	return stream.CloseAndRecv()
}

// sendPart sends the first messages of a parcel and then ends the connection's stream.
func (p *passage) sendPart(ctx context.Context, x parcel, tiles int) error {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	stream, err := p.upstream.Deliver(ctx)
	if err != nil {
		return err
	}
	err = stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: x.header}})
	for _, part := range x.tiles[:min(tiles, len(x.tiles))] {
		if err == nil {
			err = stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Tiles{Tiles: part}})
		}
	}
	return err
}
