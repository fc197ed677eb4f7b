// Package farm serves FarmService, the coordinator's side of the workers' protocol, over gRPC.
// Handlers decode, call the coordinator, and encode.
package farm

import (
	"cmp"
	"context"
	"crypto/tls"
	"errors"
	"fmt"
	"io"
	"log/slog"
	"net"
	"time"

	grpcprom "github.com/grpc-ecosystem/go-grpc-middleware/providers/prometheus"
	"github.com/prometheus/client_golang/prometheus"
	"google.golang.org/grpc"
	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/credentials"
	"google.golang.org/grpc/keepalive"
	"google.golang.org/grpc/peer"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

const (
	// maxMessage holds the header of a delivery with chain states, and a lease answer with them.
	maxMessage = 72 << 20
	// chunkBytes of a bundle's files per message.
	chunkBytes = 512 << 10
	// stopTimeout bounds the wait for calls under way.
	stopTimeout = 5 * time.Second
	// A worker whose connection is silent for keepaliveTime is pinged; one that pings more often than
	// every pingPause is cut off.
	keepaliveTime    = 10 * time.Second
	keepaliveTimeout = 5 * time.Second
	pingPause        = time.Second
	// handshakeTimeout is what a new connection has to show that it is a worker.
	handshakeTimeout = 10 * time.Second
	// maxStreams of one connection, generous beside a worker's lease, heartbeat, bundle and two
	// deliveries; each may hold a message.
	maxStreams     = 32
	maxHeaderBytes = 16 << 10
	// streamWindow is what a call may have sent before it is read: a delivery that waits for room has
	// no more in memory.
	streamWindow = 256 << 10
)

// Options of a server.
type Options struct {
	// Farm and Blobs are required.
	Farm   *coordinator.Coordinator
	Blobs  *blob.Store
	Logger *slog.Logger
	// TLS for the connections, which should ask for workers' certificates; nil: none.
	TLS *tls.Config
	// Calls counts the workers' calls; nil: nobody does.
	Calls *grpcprom.ServerMetrics
	// MessagePatience is how long a delivery may be silent; 0: 30 s.
	MessagePatience time.Duration
}

// Server is the gRPC server.
type Server struct {
	farmv1.UnimplementedFarmServiceServer
	farm  *coordinator.Coordinator
	blobs *blob.Store
	log   *slog.Logger
	grpc  *grpc.Server

	messagePatience time.Duration

	ctx context.Context // ends the long polls
	end context.CancelFunc
}

// NewServer returns a server that is ready to Serve.
func NewServer(o Options) *Server {
	if o.Logger == nil {
		o.Logger = slog.New(slog.DiscardHandler)
	}
	s := &Server{
		farm: o.Farm, blobs: o.Blobs, log: o.Logger,
		messagePatience: cmp.Or(o.MessagePatience, defaultMessagePatience),
	}
	s.ctx, s.end = context.WithCancel(context.Background())
	s.grpc = grpc.NewServer(append(counting(o.Calls), serverOptions(o.TLS)...)...)
	farmv1.RegisterFarmServiceServer(s.grpc, s)
	if o.Calls != nil {
		o.Calls.InitializeMetrics(s.grpc)
	}
	return s
}

func serverOptions(secure *tls.Config) []grpc.ServerOption {
	options := []grpc.ServerOption{
		grpc.MaxRecvMsgSize(maxMessage),
		grpc.MaxSendMsgSize(maxMessage),
		grpc.MaxConcurrentStreams(maxStreams),
		grpc.MaxHeaderListSize(maxHeaderBytes),
		grpc.InitialWindowSize(streamWindow),
		grpc.InitialConnWindowSize(4 * streamWindow),
		grpc.ConnectionTimeout(handshakeTimeout),
		grpc.KeepaliveParams(keepalive.ServerParameters{Time: keepaliveTime, Timeout: keepaliveTimeout}),
		grpc.KeepaliveEnforcementPolicy(keepalive.EnforcementPolicy{MinTime: pingPause, PermitWithoutStream: true}),
	}
	if secure != nil {
		options = append(options, grpc.Creds(credentials.NewTLS(secure)))
	}
	return options
}

// NewCalls makes what counts the calls of workers, by method and code, under the names that
// dashboards of gRPC servers know (grpc_server_handled_total and others).
func NewCalls() *grpcprom.ServerMetrics {
	return grpcprom.NewServerMetrics(grpcprom.WithServerHandlingTimeHistogram(
		grpcprom.WithHistogramBuckets(prometheus.ExponentialBuckets(0.001, 4, 8))))
}

func counting(calls *grpcprom.ServerMetrics) []grpc.ServerOption {
	if calls == nil {
		return nil
	}
	return []grpc.ServerOption{
		grpc.ChainUnaryInterceptor(calls.UnaryServerInterceptor()),
		grpc.ChainStreamInterceptor(calls.StreamServerInterceptor()),
	}
}

// Serve serves a listener until Stop.
func (s *Server) Serve(l net.Listener) error { return s.grpc.Serve(l) }

// Stop ends the long polls, waits a little for calls under way and then cuts them off.
func (s *Server) Stop() {
	s.end()
	done := make(chan struct{})
	go func() {
		s.grpc.GracefulStop()
		close(done)
	}()
	select {
	case <-done:
	case <-time.After(stopTimeout):
		s.grpc.Stop()
		<-done
	}
}

// Register implements FarmService.
func (s *Server) Register(ctx context.Context, in *farmv1.RegisterRequest) (*farmv1.RegisterResponse, error) {
	out, err := s.farm.Register(ctx, in)
	if subject := subjectOf(ctx); err == nil && subject != "" {
		s.log.InfoContext(ctx, "worker's certificate", slog.String("worker", out.GetWorkerId()), slog.String("subject", subject))
	}
	return out, toStatus(err)
}

// subjectOf the certificate that a caller showed; empty without TLS.
func subjectOf(ctx context.Context) string {
	from, known := peer.FromContext(ctx)
	if !known {
		return ""
	}
	info, secure := from.AuthInfo.(credentials.TLSInfo)
	if !secure || len(info.State.PeerCertificates) == 0 {
		return ""
	}
	leaf := info.State.PeerCertificates[0]
	return fmt.Sprintf("%s, serial %x", leaf.Subject, leaf.SerialNumber)
}

// Lease implements FarmService.
func (s *Server) Lease(ctx context.Context, in *farmv1.LeaseRequest) (*farmv1.LeaseResponse, error) {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	defer context.AfterFunc(s.ctx, cancel)()
	out, err := s.farm.Lease(ctx, in)
	if s.ctx.Err() != nil && err != nil {
		return nil, status.Error(codes.Unavailable, "the coordinator is stopping")
	}
	return out, toStatus(err)
}

// Heartbeat implements FarmService.
func (s *Server) Heartbeat(ctx context.Context, in *farmv1.HeartbeatRequest) (*farmv1.HeartbeatResponse, error) {
	out, err := s.farm.Heartbeat(ctx, in)
	return out, toStatus(err)
}

// Report implements FarmService.
func (s *Server) Report(ctx context.Context, in *farmv1.ReportRequest) (*farmv1.ReportResponse, error) {
	out, err := s.farm.Report(ctx, in)
	return out, toStatus(err)
}

// Release implements FarmService.
func (s *Server) Release(ctx context.Context, in *farmv1.ReleaseRequest) (*farmv1.ReleaseResponse, error) {
	out, err := s.farm.Release(ctx, in)
	return out, toStatus(err)
}

// FetchBundle implements FarmService.
func (s *Server) FetchBundle(in *farmv1.FetchBundleRequest, stream grpc.ServerStreamingServer[farmv1.FetchBundleResponse]) error {
	files, err := s.blobs.Manifest(stream.Context(), in.GetBundleDigest())
	if err != nil {
		return toStatus(err)
	}
	manifest := &scenev1.BundleManifest{}
	for _, f := range files {
		manifest.Files = append(manifest.Files, &scenev1.BundleFile{Path: f.Path, Size: uint64(f.Size), Sha256: f.SHA256})
	}
	opening := &farmv1.FetchBundleResponse{Content: &farmv1.FetchBundleResponse_Manifest{Manifest: manifest}}
	if err := stream.Send(opening); err != nil {
		return err
	}
	for _, f := range files {
		if err := s.sendFile(stream, f); err != nil {
			return toStatus(err)
		}
	}
	return nil
}

func (s *Server) sendFile(stream grpc.ServerStreamingServer[farmv1.FetchBundleResponse], f blob.File) error {
	r, err := s.blobs.OpenFile(stream.Context(), f.SHA256)
	if err != nil {
		return err
	}
	defer r.Close()
	buffer := make([]byte, chunkBytes)
	for sent := int64(0); sent < f.Size; {
		n, err := io.ReadFull(r, buffer[:min(chunkBytes, f.Size-sent)])
		if err != nil {
			return err
		}
		sent += int64(n)
		// Send encodes before it returns, so the buffer can be used again.
		if err := stream.Send(&farmv1.FetchBundleResponse{Content: &farmv1.FetchBundleResponse_Data{Data: buffer[:n]}}); err != nil {
			return err
		}
	}
	// At its end the content is compared with its digest.
	_, err = io.Copy(io.Discard, r)
	return err
}

// toStatus is the one place where errors become gRPC codes.
func toStatus(err error) error {
	switch {
	case err == nil:
		return nil
	case errors.Is(err, job.ErrNotFound), errors.Is(err, blob.ErrNotFound):
		return status.Error(codes.NotFound, err.Error())
	case errors.Is(err, job.ErrInvalid), errors.Is(err, blob.ErrName):
		return status.Error(codes.InvalidArgument, err.Error())
	case errors.Is(err, coordinator.ErrBusy):
		return status.Error(codes.ResourceExhausted, err.Error())
	case errors.Is(err, job.ErrUnavailable):
		return status.Error(codes.Unavailable, err.Error())
	case errors.Is(err, context.Canceled):
		return status.Error(codes.Canceled, err.Error())
	case errors.Is(err, context.DeadlineExceeded):
		return status.Error(codes.DeadlineExceeded, err.Error())
	}
	if _, ok := status.FromError(err); ok {
		return err
	}
	return status.Error(codes.Internal, err.Error())
}
