// Package bolt keeps the store in one bbolt file, for a coordinator with a data directory of its
// own. Every method is one transaction, synced to disk before it returns.
//
// Only one process can have the file open. Leases and members therefore live in memory: whoever held
// a lease in an earlier process is gone. Epochs are in the file, they grow over restarts.
package bolt

import (
	"context"
	"encoding/binary"
	"encoding/json"
	"fmt"
	"os"
	"path/filepath"
	"slices"
	"strconv"
	"sync"
	"time"

	"go.etcd.io/bbolt"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// openTimeout bounds the wait for another process that holds the file.
const openTimeout = 2 * time.Second

// Buckets. Events holds one bucket per job, keyed by big-endian sequence; the orders hold the ids of
// jobs and sequences by big-endian number.
var (
	jobsBucket          = []byte("jobs")
	orderBucket         = []byte("order")
	ownersBucket        = []byte("owners")
	keysBucket          = []byte("keys")
	eventsBucket        = []byte("events")
	sequencesBucket     = []byte("sequences")
	sequenceOrderBucket = []byte("sequence order")
	farmBucket          = []byte("farm") // of one entry, farmKey
)

// farmKey holds the id of the farm.
var farmKey = []byte("id")

// Store is a store.Store in a file.
type Store struct {
	db  *bbolt.DB
	now func() time.Time

	mu      sync.Mutex // over each method; taken before a transaction
	leases  map[string]lease
	members map[string]membership
	changes []store.Change // the latest, at most store.MaxChanges
	changed uint64         // how many there were of this process
}

var _ store.Store = (*Store)(nil)

type lease struct {
	owner string
	until time.Time
}

type membership struct {
	store.Member
	until time.Time
}

// ownership is the durable part of who owns a job.
type ownership struct {
	Epoch   uint64 `json:"epoch"`
	Settled bool   `json:"settled,omitempty"` // released since it ended
}

// keyEntry remembers what an idempotency key was used for.
type keyEntry struct {
	ID          string `json:"job"` // of a job or a sequence
	Fingerprint string `json:"fingerprint"`
}

// Open opens or creates the file and its directory; now is the clock of the leases, nil: time.Now.
// It fails if another process has the file open, which is what keeps two coordinators off one data
// directory: open it before anything else there.
func Open(path string, now func() time.Time) (*Store, error) {
	if now == nil {
		now = time.Now
	}
	if err := os.MkdirAll(filepath.Dir(path), 0o750); err != nil {
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	db, err := bbolt.Open(path, 0o600, &bbolt.Options{Timeout: openTimeout})
	if err != nil {
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	if err := db.Update(createBuckets); err != nil {
		db.Close()
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	return &Store{db: db, now: now, leases: make(map[string]lease), members: make(map[string]membership)}, nil
}

func createBuckets(tx *bbolt.Tx) error {
	for _, name := range [][]byte{
		jobsBucket, orderBucket, ownersBucket, keysBucket, eventsBucket, sequencesBucket, sequenceOrderBucket, farmBucket,
	} {
		if _, err := tx.CreateBucketIfNotExists(name); err != nil {
			return err
		}
	}
	order := tx.Bucket(orderBucket)
	if k, _ := order.Cursor().First(); k != nil {
		return nil
	}
	return tx.Bucket(jobsBucket).ForEach(func(id, v []byte) error { // a file from before there was an order
		var r store.Record
		if err := json.Unmarshal(v, &r); err != nil {
			return err
		}
		return order.Put(bigEndian(r.Number), id)
	})
}

// Close closes the file.
func (s *Store) Close() error { return s.db.Close() }

// SwapFarm implements store.Store.
func (s *Store) SwapFarm(_ context.Context, old, next string) (now string, err error) {
	err = s.db.Update(func(tx *bbolt.Tx) error {
		farm := tx.Bucket(farmBucket)
		if now = string(farm.Get(farmKey)); now != old || now == next {
			return nil
		}
		now = next
		return farm.Put(farmKey, []byte(next))
	})
	return now, wrap("id of the farm", err)
}

// CreateJob implements store.Store.
func (s *Store) CreateJob(_ context.Context, c store.Claim, r store.Record, key, fingerprint string) (stored store.Record, created bool, err error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	err = s.db.Update(func(tx *bbolt.Tx) error {
		id, err := findKey(tx, key, fingerprint)
		if err != nil {
			return err
		}
		if id == "" {
			id = r.ID // the same call again may find it
		}
		found, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &stored)
		created = found && id == r.ID
		if err != nil || found {
			return err
		}
		if err := insertJob(tx, &r); err != nil {
			return err
		}
		stored, created = r, true
		return putKey(tx, key, r.ID, fingerprint)
	})
	if err == nil && created {
		s.leases[r.ID] = lease{c.Owner, s.now().Add(c.TTL)}
	}
	return stored, created, wrap("create job", err)
}

// insertJob stores a new job and sets its number.
func insertJob(tx *bbolt.Tx, r *store.Record) (err error) {
	if r.Number, err = tx.Bucket(jobsBucket).NextSequence(); err != nil {
		return err
	}
	id := []byte(r.ID)
	if err := tx.Bucket(orderBucket).Put(bigEndian(r.Number), id); err != nil {
		return err
	}
	if err := putJSON(tx.Bucket(ownersBucket), id, ownership{Epoch: 1}); err != nil {
		return err
	}
	return putJSON(tx.Bucket(jobsBucket), id, r)
}

// findKey returns what an idempotency key was used for, "" for one that was not.
func findKey(tx *bbolt.Tx, key, fingerprint string) (id string, err error) {
	var entry keyEntry
	found, err := getJSON(tx.Bucket(keysBucket), []byte(key), &entry)
	if found && err == nil && entry.Fingerprint != fingerprint {
		err = store.ErrKeyReused
	}
	return entry.ID, err
}

// putKey remembers what an idempotency key was used for; an empty one nobody remembers.
func putKey(tx *bbolt.Tx, key, id, fingerprint string) error {
	if key == "" {
		return nil
	}
	return putJSON(tx.Bucket(keysBucket), []byte(key), keyEntry{id, fingerprint})
}

// UpdateJob implements store.Store.
func (s *Store) UpdateJob(_ context.Context, epoch uint64, r store.Record, events []job.Event) error {
	s.mu.Lock()
	defer s.mu.Unlock()
	goesOn := false
	err := s.update(epoch, r.ID, func(tx *bbolt.Tx, _ *ownership) error {
		jobs := tx.Bucket(jobsBucket)
		var old struct {
			Revision uint64    `json:"revision"`
			State    job.State `json:"state"`
		}
		if _, err := getJSON(jobs, []byte(r.ID), &old); err != nil {
			return err
		}
		switch {
		case r.Revision < old.Revision:
			return fmt.Errorf("%w: revision %d of job %s after %d", store.ErrFenced, r.Revision, r.ID, old.Revision)
		case r.Revision == old.Revision:
			return nil
		}
		goesOn = old.State.Ended() && !r.State.Ended()
		if err := putJSON(jobs, []byte(r.ID), r); err != nil || len(events) == 0 {
			return err
		}
		return appendEvents(tx, r.ID, events)
	})
	if err == nil && goesOn {
		s.note(store.Change{ID: r.ID})
	}
	return wrap("update job", err)
}

func appendEvents(tx *bbolt.Tx, id string, events []job.Event) error {
	bucket, err := tx.Bucket(eventsBucket).CreateBucketIfNotExists([]byte(id))
	if err != nil {
		return err
	}
	for _, e := range events {
		if err := putJSON(bucket, bigEndian(e.Sequence), e); err != nil {
			return err
		}
	}
	return trim(bucket)
}

// trim drops the oldest events beyond store.MaxEvents.
func trim(bucket *bbolt.Bucket) error {
	var keys [][]byte
	cursor := bucket.Cursor()
	for k, _ := cursor.First(); k != nil; k, _ = cursor.Next() {
		keys = append(keys, slices.Clone(k))
	}
	for i := 0; i < len(keys)-store.MaxEvents; i++ {
		if err := bucket.Delete(keys[i]); err != nil {
			return err
		}
	}
	return nil
}

// DeleteJob implements store.Store.
func (s *Store) DeleteJob(_ context.Context, epoch uint64, id string) error {
	s.mu.Lock()
	defer s.mu.Unlock()
	err := s.update(epoch, id, func(tx *bbolt.Tx, _ *ownership) error {
		var r store.Record
		if _, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &r); err != nil {
			return err
		}
		if err := tx.Bucket(orderBucket).Delete(bigEndian(r.Number)); err != nil {
			return err
		}
		for _, name := range [][]byte{jobsBucket, ownersBucket} {
			if err := tx.Bucket(name).Delete([]byte(id)); err != nil {
				return err
			}
		}
		if err := deleteKeysOf(tx.Bucket(keysBucket), id); err != nil {
			return err
		}
		if err := leaveSequence(tx, r.FrameOf); err != nil {
			return err
		}
		events := tx.Bucket(eventsBucket)
		if events.Bucket([]byte(id)) == nil {
			return nil
		}
		return events.DeleteBucket([]byte(id))
	})
	if err == nil {
		delete(s.leases, id)
		s.note(store.Change{ID: id, Deleted: true})
	}
	return wrap("delete job", err)
}

func deleteKeysOf(keys *bbolt.Bucket, id string) error {
	var stale [][]byte
	err := keys.ForEach(func(k, v []byte) error {
		var entry keyEntry
		if err := json.Unmarshal(v, &entry); err != nil {
			return err
		}
		if entry.ID == id {
			stale = append(stale, slices.Clone(k))
		}
		return nil
	})
	for _, k := range stale {
		if err == nil {
			err = keys.Delete(k)
		}
	}
	return err
}

// Job implements store.Store.
func (s *Store) Job(_ context.Context, id string) (store.Owned, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	var r store.Record
	err := s.db.View(func(tx *bbolt.Tx) error {
		found, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &r)
		if err == nil && !found {
			err = notFound(id)
		}
		return err
	})
	return store.Owned{Record: r, Owner: s.owner(id)}, wrap("get job", err)
}

// Jobs implements store.Store.
func (s *Store) Jobs(_ context.Context, before uint64, limit int) ([]store.Owned, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	var jobs []store.Owned
	err := s.db.View(func(tx *bbolt.Tx) error {
		for _, id := range page(tx.Bucket(orderBucket), before, limit) {
			var r store.Record
			if _, err := getJSON(tx.Bucket(jobsBucket), id, &r); err != nil {
				return err
			}
			jobs = append(jobs, store.Owned{Record: r, Owner: s.owner(r.ID)})
		}
		return nil
	})
	return jobs, wrap("list jobs", err)
}

// JobsByID implements store.Store.
func (s *Store) JobsByID(_ context.Context, ids []string) ([]store.Owned, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	var jobs []store.Owned
	err := s.db.View(func(tx *bbolt.Tx) error {
		for _, id := range ids {
			var r store.Record
			found, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &r)
			if err != nil {
				return err
			}
			if found {
				jobs = append(jobs, store.Owned{Record: r, Owner: s.owner(id)})
			}
		}
		return nil
	})
	return jobs, wrap("get jobs", err)
}

// Events implements store.Store.
func (s *Store) Events(_ context.Context, id string, after uint64) ([]job.Event, error) {
	var events []job.Event
	err := s.db.View(func(tx *bbolt.Tx) error {
		bucket := tx.Bucket(eventsBucket).Bucket([]byte(id))
		if bucket == nil || after == ^uint64(0) {
			return nil
		}
		cursor := bucket.Cursor()
		for k, v := cursor.Seek(bigEndian(after + 1)); k != nil; k, v = cursor.Next() {
			var e job.Event
			if err := json.Unmarshal(v, &e); err != nil {
				return err
			}
			events = append(events, e)
		}
		return nil
	})
	return events, wrap("events", err)
}

// note keeps a change for those who ask; they are of this process as the marks are. Requires: mu.
func (s *Store) note(change store.Change) {
	s.changed++
	s.changes = append(s.changes, change)
	if extra := len(s.changes) - store.MaxChanges; extra > 0 {
		s.changes = slices.Delete(s.changes, 0, extra)
	}
}

// Changes implements store.Store. A mark is how many there were.
func (s *Store) Changes(_ context.Context, mark string) ([]store.Change, string, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	next := strconv.FormatUint(s.changed, 10)
	if mark == "" {
		return nil, next, nil
	}
	seen, err := strconv.ParseUint(mark, 10, 64)
	if err != nil {
		return nil, "", wrap("changes", err)
	}
	fresh := min(int(s.changed-seen), len(s.changes))
	return slices.Clone(s.changes[len(s.changes)-fresh:]), next, nil
}

func bigEndian(n uint64) []byte { return binary.BigEndian.AppendUint64(nil, n) }

func putJSON(b *bbolt.Bucket, key []byte, v any) error {
	content, err := json.Marshal(v)
	if err != nil {
		return fmt.Errorf("%w: %w", store.ErrNotJSON, err)
	}
	return b.Put(key, content)
}

func getJSON(b *bbolt.Bucket, key []byte, v any) (bool, error) {
	content := b.Get(key)
	if content == nil {
		return false, nil
	}
	return true, json.Unmarshal(content, v)
}

func notFound(id string) error { return fmt.Errorf("job %s: %w", id, job.ErrNotFound) }

func wrap(what string, err error) error {
	if err == nil {
		return nil
	}
	return fmt.Errorf("bolt: %s: %w", what, err)
}
