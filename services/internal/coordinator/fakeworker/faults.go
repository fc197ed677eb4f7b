package fakeworker

import (
	"context"
	"errors"
	"slices"

	"google.golang.org/protobuf/proto"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/film"
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
	Failing         // report that the tasks cannot be done
)

var errFailing = errors.New("this worker does no such task")

func (w *Worker) deliver(ctx context.Context, header *farmv1.BatchHeader, tiles []*farmv1.Tile) error {
	fault := None
	if w.Fault != nil {
		fault = w.Fault()
	}
	switch fault {
	case Vanish:
		w.become("")
		w.instance++
		return nil
	case Repeat:
		if _, err := w.Send(ctx, header, tiles); err != nil {
			return err
		}
	case Stale:
		w.hold(nil)
		sleep(ctx, w.StaleDelay)
	case BitFlip, Forged:
		header, tiles = w.damage(header, tiles, fault)
	case Truncated:
		tiles = tiles[1:]
	case Abandoned:
		return w.breakOff(ctx, header, tiles)
	case Failing:
		for _, s := range header.GetSegments() {
			if err := w.fail(ctx, s.GetLease(), errFailing); err != nil {
				return err
			}
		}
		return nil
	}
	_, err := w.Send(ctx, header, tiles)
	return err
}

// damage replaces one tile by another content.
func (w *Worker) damage(header *farmv1.BatchHeader, tiles []*farmv1.Tile, fault Fault) (*farmv1.BatchHeader, []*farmv1.Tile) {
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
func (w *Worker) Send(ctx context.Context, header *farmv1.BatchHeader, tiles []*farmv1.Tile) (*farmv1.DeliverResponse, error) {
	stream, err := w.Client.Deliver(ctx)
	if err != nil {
		return nil, err
	}
	opening := &farmv1.DeliverHeader{WorkerId: w.id, Batch: header}
	if err := stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: opening}}); err != nil {
		_, err = stream.CloseAndRecv()
		return nil, err
	}
	for part := range slices.Chunk(tiles, 5) {
		message := &farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Tiles{Tiles: &farmv1.DeliverTiles{Tiles: part}}}
		if stream.Send(message) != nil {
			break // CloseAndRecv has the reason
		}
	}
	return stream.CloseAndRecv()
}

func (w *Worker) breakOff(ctx context.Context, header *farmv1.BatchHeader, tiles []*farmv1.Tile) error {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	stream, err := w.Client.Deliver(ctx)
	if err != nil {
		return err
	}
	opening := &farmv1.DeliverHeader{WorkerId: w.id, Batch: header}
	_ = stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Header{Header: opening}})
	_ = stream.Send(&farmv1.DeliverRequest{Content: &farmv1.DeliverRequest_Tiles{Tiles: &farmv1.DeliverTiles{Tiles: tiles[:1]}}})
	return nil
}
