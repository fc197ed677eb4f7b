package farmid_test

import (
	"context"
	"errors"
	"io"
	"path/filepath"
	"strings"
	"sync"
	"testing"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/blob/s3/s3test"
	"metrofarm/services/internal/farmid"
	"metrofarm/services/internal/store/bolt"
)

func newStore(t *testing.T) *bolt.Store {
	t.Helper()
	s, err := bolt.Open(filepath.Join(t.TempDir(), "metrofarm.db"), nil)
	if err != nil {
		t.Fatal(err)
	}
	t.Cleanup(func() { s.Close() })
	return s
}

func newBlobs(t *testing.T) *blob.Store {
	t.Helper()
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	return blob.New(backend)
}

func newPair(t *testing.T) farmid.Pair {
	t.Helper()
	return farmid.Pair{Store: newStore(t), Blobs: newBlobs(t)}
}

func claimed(t *testing.T, p farmid.Pair, adopt string) string {
	t.Helper()
	id, err := p.Claim(t.Context(), adopt)
	if err != nil {
		t.Fatal(err)
	}
	if id == "" {
		t.Fatal("a farm without an id")
	}
	return id
}

// refused expects a mismatch that says all of this.
func refused(t *testing.T, p farmid.Pair, adopt string, says ...string) {
	t.Helper()
	id, err := p.Claim(t.Context(), adopt)
	if !errors.Is(err, farmid.ErrMismatch) {
		t.Fatalf("claimed as %q, error %v", id, err)
	}
	for _, part := range says {
		if !strings.Contains(err.Error(), part) {
			t.Errorf("%q is not said: %v", part, err)
		}
	}
}

func check(t *testing.T, err error) {
	t.Helper()
	if err != nil {
		t.Fatal(err)
	}
}

func TestAFarmKeepsItsID(t *testing.T) {
	t.Parallel()
	t.Run("directory", func(t *testing.T) { testAFarmKeepsItsID(t, newBlobs(t)) })
	t.Run("bucket", func(t *testing.T) {
		backend, err := s3.Open(t.Context(), s3test.Start(t).Bucket())
		check(t, err)
		testAFarmKeepsItsID(t, blob.New(backend))
	})
}

func testAFarmKeepsItsID(t *testing.T, blobs *blob.Store) {
	p := farmid.Pair{Store: newStore(t), Blobs: blobs}
	id := claimed(t, p, "")
	if again := claimed(t, p, ""); again != id {
		t.Errorf("farm %s, then %s", id, again)
	}
	check(t, p.Check(t.Context(), id))
	refused(t, farmid.Pair{Store: newStore(t), Blobs: blobs}, "", id)
}

func TestAFarmFromBeforeThereWereIDs(t *testing.T) {
	t.Parallel()
	p := newPair(t)
	check(t, p.Blobs.WriteBlob(t.Context(), "checkpoint-1", func(io.Writer) error { return nil }))
	claimed(t, p, "")
}

func TestBlobsOfAnotherFarm(t *testing.T) {
	t.Parallel()
	one, two := newPair(t), newPair(t)
	first, second := claimed(t, one, ""), claimed(t, two, "")
	mixed := farmid.Pair{Store: one.Store, Blobs: two.Blobs}
	for _, adopt := range []string{"", first, farmid.Unmarked} {
		refused(t, mixed, adopt, first, second, "--store", "--blobs", "--adopt-blobs "+second)
	}
	check(t, two.Check(t.Context(), second)) // as nothing has changed
	if id := claimed(t, mixed, second); id != first {
		t.Errorf("farm %s, want %s", id, first)
	}
	claimed(t, mixed, second)
	claimed(t, mixed, "")
	if err := two.Check(t.Context(), second); !errors.Is(err, farmid.ErrMismatch) || !strings.Contains(err.Error(), first) {
		t.Errorf("the farm that lost its blobs: %v", err)
	}
	refused(t, two, "", first, second)
}

func TestAStoreThatWasLost(t *testing.T) {
	t.Parallel()
	p := newPair(t)
	first := claimed(t, p, "")
	lost := farmid.Pair{Store: newStore(t), Blobs: p.Blobs}
	if err := lost.Check(t.Context(), first); !errors.Is(err, farmid.ErrMismatch) || !strings.Contains(err.Error(), "none") {
		t.Errorf("while a coordinator runs: %v", err)
	}
	for range 2 {
		refused(t, lost, "", first, "--adopt-blobs "+first)
	}
	check(t, p.Check(t.Context(), first))
	if second := claimed(t, lost, first); second == first {
		t.Error("a new farm has the id of another that may live on")
	}
	refused(t, p, "", first)
}

func TestBlobsThatTheOthersDoNotSee(t *testing.T) {
	t.Parallel()
	p := newPair(t)
	id := claimed(t, p, "")
	unshared := farmid.Pair{Store: p.Store, Blobs: newBlobs(t)}
	refused(t, unshared, "", id, "--adopt-blobs none")
	refused(t, unshared, id)
	if moved := claimed(t, unshared, farmid.Unmarked); moved != id {
		t.Errorf("farm %s, want %s", moved, id)
	}
}

// TestAStartThatBrokeOff: whatever the last thing was that it did, the next one ends it.
func TestAStartThatBrokeOff(t *testing.T) {
	t.Parallel()
	for name, end := range map[string]breaking{
		"before all": {at: 1}, "before the blobs": {at: 1, after: true}, "before the store knows": {at: 2}, "at the end": {at: 2, after: true},
	} {
		t.Run(name, func(t *testing.T) {
			p := newPair(t)
			var ctx context.Context
			ctx, end.kill = context.WithCancel(t.Context())
			end.Store = p.Store
			if _, err := (farmid.Pair{Store: &end, Blobs: p.Blobs}).Claim(ctx, ""); (err == nil) != (name == "at the end") {
				t.Fatalf("error %v", err)
			}
			check(t, p.Check(t.Context(), claimed(t, p, "")))
		})
	}
}

// breaking ends the process, as it were, at one of the swaps: before or after it.
type breaking struct {
	farmid.Store
	at    int
	after bool
	kill  context.CancelFunc
}

func (b *breaking) SwapFarm(ctx context.Context, old, next string) (string, error) {
	b.at--
	if b.at == 0 && !b.after {
		return "", context.Canceled
	}
	now, err := b.Store.SwapFarm(ctx, old, next)
	if b.at == 0 {
		b.kill()
	}
	return now, err
}

func TestManyStartAtOnce(t *testing.T) {
	t.Parallel()
	p := newPair(t)
	var group sync.WaitGroup
	ids := make([]string, 8)
	for i := range ids {
		group.Go(func() {
			var err error
			if ids[i], err = p.Claim(t.Context(), ""); err != nil {
				t.Error(err)
			}
		})
	}
	group.Wait()
	for _, id := range ids {
		check(t, p.Check(t.Context(), id))
	}
}
