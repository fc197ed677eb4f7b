// Package checkpoint writes the progress of a job to one blob and reads it back.
//
// Layout: the magic with the format's version, a zstd stream, and the SHA-256 of all before it. The
// stream holds the length and gob encoding of everything but the films, then the films of the
// closed rounds and of each open round in canonical form.
package checkpoint

import (
	"bufio"
	"bytes"
	"crypto/sha256"
	"encoding/binary"
	"encoding/gob"
	"errors"
	"fmt"
	"io"

	"github.com/klauspost/compress/zstd"
	"google.golang.org/protobuf/proto"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/render"
)

// ErrCorrupt: the blob is not a whole checkpoint of this version.
var ErrCorrupt = errors.New("corrupt checkpoint")

// BlobPrefix begins the names of all checkpoints among the named blobs.
const BlobPrefix = "checkpoint-"

const (
	magic        = "MFCKPT01"
	maxMetaBytes = 4 << 30
)

// Checkpoint is what a job resumes from.
type Checkpoint struct {
	State *render.State
	Extra Extra
}

// Extra is what the coordinator keeps beside the film.
type Extra struct {
	WallSeconds float64
	LoadSeconds float64
	// Bootstrap phase: cost and anomalies.
	BootstrapEvaluations, BootstrapRays uint64
	BootstrapCPUSeconds                 float64
	BootstrapAnomalies                  [5]uint64
	// Report is what the worker found in the scene (protobuf).
	Report []byte
}

// meta is the gob part: State without its films.
type meta struct {
	Spec     []byte
	Cells    int
	Progress render.Progress
	Open     []render.OpenRecord
	Extra    Extra
}

// Write writes a checkpoint. Requires: c.State is a snapshot that nothing changes.
func Write(w io.Writer, c Checkpoint) error {
	hash := sha256.New()
	buffered := bufio.NewWriterSize(io.MultiWriter(w, hash), 1<<20)
	if _, err := buffered.WriteString(magic); err != nil {
		return fmt.Errorf("checkpoint: %w", err)
	}
	packer, err := zstd.NewWriter(buffered, zstd.WithEncoderLevel(zstd.SpeedFastest), zstd.WithEncoderConcurrency(1))
	if err != nil {
		return fmt.Errorf("checkpoint: %w", err)
	}
	err = writeContent(packer, c)
	if closeErr := packer.Close(); err == nil {
		err = closeErr
	}
	if err == nil {
		err = buffered.Flush()
	}
	if err == nil {
		_, err = w.Write(hash.Sum(nil))
	}
	if err != nil {
		return fmt.Errorf("checkpoint: write: %w", err)
	}
	return nil
}

func writeContent(w io.Writer, c Checkpoint) error {
	spec, err := proto.Marshal(c.State.Spec)
	if err != nil {
		return err
	}
	m := meta{Spec: spec, Cells: c.State.Cells, Progress: c.State.Progress, Extra: c.Extra}
	films := []*film.Film{c.State.Total}
	for _, o := range c.State.Open {
		films = append(films, o.Film)
		m.Open = append(m.Open, o.OpenRecord)
	}
	var encoded bytes.Buffer
	if err := gob.NewEncoder(&encoded).Encode(m); err != nil {
		return err
	}
	if err := binary.Write(w, binary.LittleEndian, uint64(encoded.Len())); err != nil {
		return err
	}
	if _, err := encoded.WriteTo(w); err != nil {
		return err
	}
	for _, f := range films {
		if err := f.Write(w); err != nil {
			return err
		}
	}
	return nil
}

// Read reads a checkpoint and checks it. Anything but a whole, unchanged one is ErrCorrupt.
func Read(r io.Reader) (Checkpoint, error) {
	content, err := io.ReadAll(r)
	if err != nil {
		return Checkpoint{}, fmt.Errorf("checkpoint: read: %w", err)
	}
	end := len(content) - sha256.Size
	if end < len(magic) || string(content[:len(magic)]) != magic {
		return Checkpoint{}, fmt.Errorf("%w: no %s header", ErrCorrupt, magic)
	}
	if sum := sha256.Sum256(content[:end]); !bytes.Equal(sum[:], content[end:]) {
		return Checkpoint{}, fmt.Errorf("%w: checksum differs", ErrCorrupt)
	}
	unpacker, err := zstd.NewReader(bytes.NewReader(content[len(magic):end]), zstd.WithDecoderConcurrency(1))
	if err != nil {
		return Checkpoint{}, fmt.Errorf("%w: %w", ErrCorrupt, err)
	}
	defer unpacker.Close()
	c, err := readContent(bufio.NewReaderSize(unpacker, 1<<20))
	if err != nil {
		return Checkpoint{}, fmt.Errorf("%w: %w", ErrCorrupt, err)
	}
	return c, nil
}

func readContent(r io.Reader) (Checkpoint, error) {
	m, err := readMeta(r)
	if err != nil {
		return Checkpoint{}, err
	}
	spec := &jobv1.ResolvedSpec{}
	if err := proto.Unmarshal(m.Spec, spec); err != nil {
		return Checkpoint{}, err
	}
	total, err := film.Read(r)
	if err != nil {
		return Checkpoint{}, err
	}
	open := make([]*render.Open, len(m.Open))
	for i, record := range m.Open {
		open[i] = &render.Open{OpenRecord: record}
		if open[i].Film, err = film.Read(r); err != nil {
			return Checkpoint{}, err
		}
	}
	state, err := render.Resume(spec, m.Cells, total, m.Progress, open)
	if err != nil {
		return Checkpoint{}, err
	}
	return Checkpoint{State: state, Extra: m.Extra}, nil
}

func readMeta(r io.Reader) (meta, error) {
	var size uint64
	if err := binary.Read(r, binary.LittleEndian, &size); err != nil {
		return meta{}, err
	}
	if size > maxMetaBytes {
		return meta{}, fmt.Errorf("metadata of %d bytes", size)
	}
	var m meta
	limited := &io.LimitedReader{R: r, N: int64(size)}
	// gob may read ahead only within its own part, which is why it is bounded.
	if err := gob.NewDecoder(limited).Decode(&m); err != nil {
		return meta{}, err
	}
	_, err := io.Copy(io.Discard, limited)
	return m, err
}
