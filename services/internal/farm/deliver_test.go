package farm

import (
	"context"
	"net"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/credentials/insecure"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/store/bolt"
)

// serve starts a server with one slot for deliveries, and returns a client of it.
func serve(t *testing.T, patience time.Duration) farmv1.FarmServiceClient {
	t.Helper()
	folder := t.TempDir()
	db, err := bolt.Open(filepath.Join(folder, "db"), nil)
	check(t, err)
	t.Cleanup(func() { db.Close() })
	backend, err := dir.Open(filepath.Join(folder, "blobs"))
	check(t, err)
	blobs := blob.New(backend)
	c, err := coordinator.New(t.Context(), coordinator.Options{Store: db, Blobs: blobs, Deliveries: 1})
	check(t, err)
	server := NewServer(Options{Farm: c, Blobs: blobs, MessagePatience: patience})
	listener, err := net.Listen("tcp", "127.0.0.1:0")
	check(t, err)
	go func() { _ = server.Serve(listener) }()
	t.Cleanup(server.Stop)
	connection, err := grpc.NewClient(listener.Addr().String(), grpc.WithTransportCredentials(insecure.NewCredentials()))
	check(t, err)
	t.Cleanup(func() { connection.Close() })
	return farmv1.NewFarmServiceClient(connection)
}

func check(t *testing.T, err error) {
	t.Helper()
	if err != nil {
		t.Fatal(err)
	}
}

// opening is a delivery for a job that does not exist, which is read to its end all the same.
func opening(t *testing.T, client farmv1.FarmServiceClient) *farmv1.DeliverRequest {
	t.Helper()
	worker, err := client.Register(t.Context(), &farmv1.RegisterRequest{Instance: strings.Repeat("a", 32), Version: "1"})
	check(t, err)
	header := &farmv1.DeliverHeader{WorkerId: worker.GetWorkerId(), Batch: &farmv1.BatchHeader{JobId: "none"}}
	return &farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: header}}
}

func tiles() *farmv1.DeliverRequest {
	return &farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Tiles{Tiles: &farmv1.DeliverTiles{}}}
}

func TestADeliveryThatFallsSilentIsBrokenOff(t *testing.T) {
	const patience = time.Second
	client := serve(t, patience)
	first := opening(t, client)
	for name, messages := range map[string][]*farmv1.DeliverRequest{
		"before its header": nil, "after its header": {first}, "among its tiles": {first, tiles()},
	} {
		t.Run(name, func(t *testing.T) {
			ctx, cancel := context.WithTimeout(t.Context(), time.Minute)
			defer cancel()
			silent, err := client.Deliver(ctx)
			check(t, err)
			for _, message := range messages {
				check(t, silent.Send(message))
			}
			// No end is sent: only the answer is waited for.
			if err := silent.RecvMsg(&farmv1.DeliverResponse{}); status.Code(err) != codes.Unavailable {
				t.Errorf("a silent delivery ends with %v", err)
			}
			again, err := client.Deliver(ctx) // the slot is free again
			check(t, err)
			check(t, again.Send(first))
			if answer, err := again.CloseAndRecv(); err != nil || answer.GetOutcome() != farmv1.Outcome_OUTCOME_SUPERSEDED {
				t.Errorf("the next delivery: %v, %v", answer, err)
			}
		})
	}
}

func TestADeliveryMayTakeLongerThanOneMessage(t *testing.T) {
	const patience = 3 * time.Second
	client := serve(t, patience)
	stream, err := client.Deliver(t.Context())
	check(t, err)
	check(t, stream.Send(opening(t, client)))
	for start := time.Now(); time.Since(start) < 3*patience/2; time.Sleep(patience / 8) {
		check(t, stream.Send(tiles()))
	}
	if answer, err := stream.CloseAndRecv(); err != nil || answer.GetOutcome() != farmv1.Outcome_OUTCOME_SUPERSEDED {
		t.Errorf("%v, %v", answer, err)
	}
}
