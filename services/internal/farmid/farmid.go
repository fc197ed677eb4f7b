// Package farmid keeps the jobs of a farm and their scenes and checkpoints together. The store and the
// blobs bear the id of their farm, which is compared at the start and before anything is swept: a
// coordinator with the blobs of another farm would delete them, for none of its jobs refers to them, and
// one whose blobs the others do not see would miss checkpoints and begin jobs again.
//
// The store decides which id a farm has, in one step. It remembers that its blobs are not known to be
// marked yet, so that a start that breaks off is made up for by the next one, and any number of
// coordinators may start at the same time. Two farms that claim the same blobs at the same moment are
// told apart when they next look: at the latest before they sweep.
package farmid

import (
	"context"
	"crypto/rand"
	"errors"
	"fmt"
	"io"
	"strings"

	"metrofarm/services/internal/blob"
)

// ErrMismatch: the store and the blobs are not known to be those of one farm.
var ErrMismatch = errors.New("the jobs (--store) and the scenes and checkpoints (--blobs) are not those of one farm")

// Unmarked stands for the farm of blobs that bear no id.
const Unmarked = "none"

const (
	// blobName names the blob that holds the id.
	blobName = "farm"
	// maxBytes of it are read.
	maxBytes = 256
	// claiming comes before the id of a farm in the store until its blobs are marked.
	claiming = "claiming "
)

// Store is where the jobs are.
type Store interface {
	// SwapFarm replaces the farm's id by next if it is old, and returns what it is then; "" is none.
	SwapFarm(ctx context.Context, old, next string) (now string, err error)
}

// Pair is what belongs to one farm.
type Pair struct {
	Store Store
	Blobs *blob.Store
}

// Claim returns the id of the farm that both belong to. A store without one begins a farm, with blobs that
// have none either. Blobs of another farm are taken only if adopt names that farm; Unmarked are those
// without an id where the store has one. Everything else fails with ErrMismatch and says what would be
// right.
func (p Pair) Claim(ctx context.Context, adopt string) (id string, err error) {
	stored, err := p.Store.SwapFarm(ctx, "", claiming+newID())
	if err != nil {
		return "", err
	}
	id, begins := strings.CutPrefix(stored, claiming)
	marked, err := p.marked(ctx)
	if err != nil {
		return "", err
	}
	fresh := marked == "" && begins
	if fresh || marked != id && adopt != "" && adopt == named(marked) {
		if marked, err = p.mark(ctx, id); err != nil {
			return "", err
		}
	}
	if marked != id {
		return "", mismatch(id, begins, marked)
	}
	if begins {
		_, err = p.Store.SwapFarm(ctx, stored, id)
	}
	return id, err
}

// Check fails with ErrMismatch unless both still belong to the farm that was claimed.
func (p Pair) Check(ctx context.Context, id string) error {
	stored, err := p.Store.SwapFarm(ctx, "", "")
	if err != nil {
		return err
	}
	marked, err := p.marked(ctx)
	if err != nil {
		return err
	}
	if stored != id || marked != id {
		return fmt.Errorf("%w any more: this coordinator is of farm %s, its store now of farm %s and its blobs of farm %s",
			ErrMismatch, id, named(stored), named(marked))
	}
	return nil
}

func newID() string { return strings.ToLower(rand.Text()[:12]) }

// named is the id that blobs bear as one writes it.
func named(id string) string {
	if id == "" {
		return Unmarked
	}
	return id
}

// marked is the id that the blobs bear, "" if they have none.
func (p Pair) marked(ctx context.Context) (string, error) {
	r, err := p.Blobs.OpenBlob(ctx, blobName)
	if errors.Is(err, blob.ErrNotFound) {
		return "", nil
	}
	if err != nil {
		return "", err
	}
	defer r.Close()
	content, err := io.ReadAll(io.LimitReader(r, maxBytes))
	if err != nil {
		return "", fmt.Errorf("reading blob %s: %w", blobName, err)
	}
	return strings.TrimSpace(string(content)), nil
}

// mark writes the id to the blobs and returns what they bear then: another farm may have been faster.
func (p Pair) mark(ctx context.Context, id string) (string, error) {
	err := p.Blobs.WriteBlob(ctx, blobName, func(w io.Writer) error {
		_, err := io.WriteString(w, id+"\n")
		return err
	})
	if err != nil {
		return "", err
	}
	return p.marked(ctx)
}

func mismatch(id string, begins bool, marked string) error {
	switch {
	case begins:
		return fmt.Errorf("%w: the blobs are those of farm %s, the store is that of none yet. If that farm lives on, give "+
			"this one --blobs of its own. If the store was lost, bring it back from a backup, or start metrofarm serve once "+
			"with --adopt-blobs %[2]s to begin a new farm with these blobs: what its jobs do not use is then deleted", ErrMismatch, marked)
	case marked == "":
		return fmt.Errorf("%w: the store is that of farm %s, which has its blobs elsewhere. Give all of its coordinators the same "+
			"--blobs, a place that they share. If its blobs were lost, or moved without blob %q, start once with "+
			"--adopt-blobs %s", ErrMismatch, id, blobName, Unmarked)
	default:
		return fmt.Errorf("%w: the store is that of farm %s, the blobs are those of farm %s. Give this coordinator the --store of "+
			"the one or the --blobs of the other. If farm %[3]s is no more, start once with --adopt-blobs %[3]s to take its blobs "+
			"over: what the jobs of farm %[2]s do not use is then deleted", ErrMismatch, id, marked)
	}
}
