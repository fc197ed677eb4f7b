package farm

import (
	"errors"
	"io"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/coordinator"
)

// defaultMessagePatience is what each message of a delivery has to arrive: it holds one of a few
// slots and the memory of its film.
const defaultMessagePatience = 30 * time.Second

// deliveries is the stream of one delivery.
type deliveries struct {
	grpc.ClientStreamingServer[farmv1.DeliverRequest, farmv1.DeliverResponse]
	patience time.Duration
}

// Deliver implements FarmService. Nothing is read before the coordinator has room for it. A batch
// whose fate is known early is still read to its end, so that the worker never sees a broken stream
// instead of the answer. A stream that falls silent is broken off; the worker then sends again.
func (s *Server) Deliver(stream grpc.ClientStreamingServer[farmv1.DeliverRequest, farmv1.DeliverResponse]) error {
	delivery, err := s.farm.Admit(stream.Context())
	if err != nil {
		return toStatus(err)
	}
	answer, err := deliveries{stream, s.messagePatience}.receive(delivery)
	if err != nil {
		delivery.Finish(false)
		return err
	}
	return stream.SendAndClose(answer)
}

func (d deliveries) receive(delivery *coordinator.Delivery) (*farmv1.DeliverResponse, error) {
	first, err := d.next()
	if err != nil {
		return nil, err
	}
	if first.GetHeader() == nil {
		return nil, status.Error(codes.InvalidArgument, "the first message is not the header")
	}
	if err := delivery.Open(d.Context(), first.GetHeader()); err != nil {
		return nil, toStatus(err)
	}
	for {
		message, err := d.next()
		if errors.Is(err, io.EOF) {
			return delivery.Finish(true), nil
		}
		if err != nil {
			return nil, err
		}
		delivery.Add(message.GetTiles().GetTiles())
	}
}

// next receives one message. After a failure there is no other: the handler returns, which ends a
// call that still waits for one.
func (d deliveries) next() (*farmv1.DeliverRequest, error) {
	type received struct {
		message *farmv1.DeliverRequest
		err     error
	}
	arrived := make(chan received, 1)
	go func() {
		message, err := d.Recv()
		arrived <- received{message, err}
	}()
	patience := time.NewTimer(d.patience)
	defer patience.Stop()
	select {
	case r := <-arrived:
		return r.message, r.err
	case <-patience.C:
		return nil, status.Errorf(codes.Unavailable, "nothing of the delivery arrived for %v", d.patience)
	}
}
