package blobtest

import (
	"crypto/sha256"
	"errors"
	"fmt"
	"io"
	"runtime"
	"strings"
	"testing"
	"time"

	"golang.org/x/sync/errgroup"

	"metrofarm/services/internal/blob"
)

const writersAtOnce = 16

func testManyWriters(t *testing.T, open func() blob.Backend) {
	content := strings.Repeat("content", 50_000)
	stores := []*blob.Store{blob.New(open()), blob.New(open())}
	sha := fmt.Sprintf("%x", sha256.Sum256([]byte(content)))
	var group errgroup.Group
	for i := range writersAtOnce {
		group.Go(func() error {
			s := stores[i%len(stores)]
			got, _, err := s.PutFile(t.Context(), strings.NewReader(content), 1<<20)
			if err != nil || got != sha {
				return fmt.Errorf("stored as %s: %w", got, err)
			}
			// Others are still writing it.
			r, err := s.OpenFile(t.Context(), sha)
			if err != nil {
				return err
			}
			_, err = io.Copy(io.Discard, r)
			return errors.Join(err, r.Close())
		})
	}
	check(t, group.Wait())
	if listed := names(t, stores[0], blob.Files); len(listed) != 1 || listed[sha].Size != int64(len(content)) {
		t.Errorf("listed %+v", listed)
	}
}

func testManyVersions(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	version := func(i int) string { return strings.Repeat(fmt.Sprintf("%02d", i), 100_000+i) }
	write(t, s, "latest", version(0))
	var group errgroup.Group
	for i := range writersAtOnce {
		group.Go(func() error { return s.WriteBlob(t.Context(), "latest", text(version(i))) })
		group.Go(func() error {
			r, err := s.OpenBlob(t.Context(), "latest")
			if err != nil {
				return err
			}
			content, err := io.ReadAll(r)
			if err = errors.Join(err, r.Close()); err != nil {
				return err
			}
			var found int
			if _, err := fmt.Sscanf(string(content[:2]), "%d", &found); err != nil || string(content) != version(found) {
				return fmt.Errorf("a mixture was read: %d bytes that begin with %.8q: %w", len(content), content, err)
			}
			return nil
		})
	}
	check(t, group.Wait())
}

func testManyNames(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	const count = 1100
	var group errgroup.Group
	group.SetLimit(writersAtOnce)
	for i := range count {
		group.Go(func() error {
			return s.WriteBlob(t.Context(), fmt.Sprintf("checkpoint-%04d", i), text("x"))
		})
	}
	check(t, group.Wait())
	listed := names(t, s, blob.Named)
	for i := range count {
		if info := listed[fmt.Sprintf("checkpoint-%04d", i)]; info.Size != 1 || time.Since(info.Modified) > time.Hour {
			t.Fatalf("blob %d of %d is listed as %+v", i, len(listed), info)
		}
	}
	seen := 0
	for range s.List(t.Context(), blob.Named) {
		if seen++; seen == 3 {
			break
		}
	}
	if len(listed) != count || seen != 3 {
		t.Errorf("listed %d of %d; left after %d of 3", len(listed), count, seen)
	}
}

const (
	bigBytes  = 64 << 20
	bigMemory = 40 << 20
)

// testBigBlob writes and reads 64 MiB in pieces and looks at the memory in use between them.
func testBigBlob(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	memory := newMemory()
	sum := sha256.New()
	check(t, s.WriteBlob(t.Context(), "big", func(w io.Writer) error {
		piece := make([]byte, 1<<20)
		for i := range bigBytes / len(piece) {
			for at := range piece {
				piece[at] = byte(at*i + at>>8)
			}
			sum.Write(piece)
			if _, err := w.Write(piece); err != nil {
				return err
			}
			memory.look(i)
		}
		return nil
	}))
	want := sum.Sum(nil)
	r, err := s.OpenBlob(t.Context(), "big")
	check(t, err)
	defer r.Close()
	sum.Reset()
	piece := make([]byte, 1<<20)
	for i := 0; ; i++ {
		n, err := io.ReadFull(r, piece)
		sum.Write(piece[:n])
		if err != nil {
			break
		}
		memory.look(i)
	}
	if got := sum.Sum(nil); string(got) != string(want) {
		t.Errorf("SHA-256 %x, want %x", got, want)
	}
	t.Logf("%d MiB in use", memory.peak>>20)
	if memory.peak > bigMemory {
		t.Errorf("%d MiB in use, allowed %d", memory.peak>>20, bigMemory>>20)
	}
}

// memory is what the process has in use above what it had at first.
type memory struct{ start, peak uint64 }

func newMemory() *memory {
	m := &memory{}
	m.look(0)
	return &memory{start: m.peak}
}

func (m *memory) look(step int) {
	if step%8 != 0 {
		return
	}
	runtime.GC()
	var stats runtime.MemStats
	runtime.ReadMemStats(&stats)
	if stats.HeapAlloc > m.start {
		m.peak = max(m.peak, stats.HeapAlloc-m.start)
	}
}

func testUnfinished(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	check(t, s.WriteBlob(t.Context(), "slow", func(w io.Writer) error {
		if err := text(strings.Repeat("a", 20<<20))(w); err != nil {
			return err
		}
		return errors.Join(s.RemoveUnfinished(t.Context(), time.Now().Add(-time.Hour)), text("b")(w))
	}))
	expectBlob(t, s, "slow", strings.Repeat("a", 20<<20)+"b")
}
