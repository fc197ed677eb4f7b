package main

import (
	"bufio"
	"errors"
	"fmt"
	"io"
	"os"

	"google.golang.org/protobuf/encoding/protodelim"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
)

// maxRecorded is the longest message in a recording: a header with chain states.
const maxRecorded = 64 << 20

// recording is a file of batches as a worker delivered them: the job's resolved spec, then the
// messages of one delivery after the other, each with its length before it.
type recording struct {
	spec    *jobv1.ResolvedSpec
	batches []recordedBatch
}

type recordedBatch struct {
	header *farmv1.BatchHeader
	tiles  []*farmv1.Tile
}

func readRecording(path string) (*recording, error) {
	file, err := os.Open(path)
	if err != nil {
		return nil, err
	}
	defer file.Close()
	in := bufio.NewReader(file)
	options := protodelim.UnmarshalOptions{MaxSize: maxRecorded}
	r := &recording{spec: &jobv1.ResolvedSpec{}}
	if err := options.UnmarshalFrom(in, r.spec); err != nil {
		return nil, fmt.Errorf("%s: spec: %w", path, err)
	}
	for {
		message := &farmv1.DeliverRequest{}
		err := options.UnmarshalFrom(in, message)
		if errors.Is(err, io.EOF) {
			break
		}
		if err != nil {
			return nil, fmt.Errorf("%s: %w", path, err)
		}
		r.add(message)
	}
	if len(r.batches) == 0 {
		return nil, fmt.Errorf("%s: holds no batch", path)
	}
	return r, nil
}

func (r *recording) add(message *farmv1.DeliverRequest) {
	if header := message.GetHeader(); header != nil {
		r.batches = append(r.batches, recordedBatch{header: header.GetBatch()})
	}
	if tiles := message.GetTiles(); tiles != nil && len(r.batches) > 0 {
		last := &r.batches[len(r.batches)-1]
		last.tiles = append(last.tiles, tiles.GetTiles()...)
	}
}

// write is the inverse of readRecording.
func (r *recording) write(path string) error {
	file, err := os.Create(path)
	if err != nil {
		return err
	}
	out := bufio.NewWriter(file)
	_, err = protodelim.MarshalTo(out, r.spec)
	for _, b := range r.batches {
		if err == nil {
			_, err = protodelim.MarshalTo(out, &farmv1.DeliverRequest{
				Content: &farmv1.DeliverRequest_Header{Header: &farmv1.DeliverHeader{Batch: b.header}},
			})
		}
		for _, t := range b.tiles {
			if err == nil {
				_, err = protodelim.MarshalTo(out, &farmv1.DeliverRequest{
					Content: &farmv1.DeliverRequest_Tiles{Tiles: &farmv1.DeliverTiles{Tiles: []*farmv1.Tile{t}}},
				})
			}
		}
	}
	return errors.Join(err, out.Flush(), file.Close())
}
