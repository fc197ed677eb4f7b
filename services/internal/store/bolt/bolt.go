// Package bolt keeps the store in one bbolt file, for a coordinator with a data directory of its
// own. Every method is one transaction, synced to disk before it returns.
package bolt

import (
	"context"
	"encoding/binary"
	"encoding/json"
	"fmt"
	"os"
	"path/filepath"
	"slices"
	"time"

	"go.etcd.io/bbolt"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// openTimeout bounds the wait for another process that holds the file.
const openTimeout = 2 * time.Second

// Buckets. Events holds one bucket per job, keyed by big-endian sequence.
var (
	metaBucket   = []byte("meta")
	jobsBucket   = []byte("jobs")
	keysBucket   = []byte("keys")
	eventsBucket = []byte("events")
	epochKey     = []byte("epoch")
)

// Store is a store.Store in a file.
type Store struct {
	db *bbolt.DB
}

var _ store.Store = (*Store)(nil)

// keyEntry remembers what an idempotency key was used for.
type keyEntry struct {
	Job         string `json:"job"`
	Fingerprint string `json:"fingerprint"`
}

// Open opens or creates the file and its directory. It fails if another process has it open, which
// is what keeps two coordinators off one data directory: open it before anything else there.
func Open(path string) (*Store, error) {
	if err := os.MkdirAll(filepath.Dir(path), 0o750); err != nil {
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	db, err := bbolt.Open(path, 0o600, &bbolt.Options{Timeout: openTimeout})
	if err != nil {
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	err = db.Update(func(tx *bbolt.Tx) error {
		for _, name := range [][]byte{metaBucket, jobsBucket, keysBucket, eventsBucket} {
			if _, err := tx.CreateBucketIfNotExists(name); err != nil {
				return err
			}
		}
		return nil
	})
	if err != nil {
		db.Close()
		return nil, fmt.Errorf("bolt: open %s: %w", path, err)
	}
	return &Store{db: db}, nil
}

// Close closes the file.
func (s *Store) Close() error { return s.db.Close() }

// Claim implements store.Store.
func (s *Store) Claim(context.Context) (uint64, error) {
	var epoch uint64
	err := s.db.Update(func(tx *bbolt.Tx) error {
		epoch = currentEpoch(tx) + 1
		return tx.Bucket(metaBucket).Put(epochKey, bigEndian(epoch))
	})
	return epoch, wrap("claim", err)
}

// CreateJob implements store.Store.
func (s *Store) CreateJob(_ context.Context, epoch uint64, r store.Record, key, fingerprint string) (stored store.Record, created bool, err error) {
	err = s.update(epoch, func(tx *bbolt.Tx) error {
		if key != "" {
			found, err := findKey(tx, key, fingerprint, &stored)
			if err != nil || found {
				return err
			}
		}
		number, err := tx.Bucket(jobsBucket).NextSequence()
		if err != nil {
			return err
		}
		r.Number = number
		stored, created = r, true
		if key != "" {
			if err := putJSON(tx.Bucket(keysBucket), []byte(key), keyEntry{r.ID, fingerprint}); err != nil {
				return err
			}
		}
		return putJSON(tx.Bucket(jobsBucket), []byte(r.ID), r)
	})
	return stored, created, wrap("create job", err)
}

func findKey(tx *bbolt.Tx, key, fingerprint string, into *store.Record) (bool, error) {
	var entry keyEntry
	found, err := getJSON(tx.Bucket(keysBucket), []byte(key), &entry)
	if err != nil || !found {
		return false, err
	}
	if entry.Fingerprint != fingerprint {
		return false, store.ErrKeyReused
	}
	return getJSON(tx.Bucket(jobsBucket), []byte(entry.Job), into)
}

// UpdateJob implements store.Store.
func (s *Store) UpdateJob(_ context.Context, epoch uint64, r store.Record, events []job.Event) error {
	err := s.update(epoch, func(tx *bbolt.Tx) error {
		jobs := tx.Bucket(jobsBucket)
		if jobs.Get([]byte(r.ID)) == nil {
			return fmt.Errorf("job %s: %w", r.ID, job.ErrNotFound)
		}
		if err := putJSON(jobs, []byte(r.ID), r); err != nil || len(events) == 0 {
			return err
		}
		return appendEvents(tx, r.ID, events)
	})
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
	err := s.update(epoch, func(tx *bbolt.Tx) error {
		jobs, events := tx.Bucket(jobsBucket), tx.Bucket(eventsBucket)
		if jobs.Get([]byte(id)) == nil {
			return fmt.Errorf("job %s: %w", id, job.ErrNotFound)
		}
		if err := jobs.Delete([]byte(id)); err != nil {
			return err
		}
		if err := deleteKeysOf(tx.Bucket(keysBucket), id); err != nil {
			return err
		}
		if events.Bucket([]byte(id)) == nil {
			return nil
		}
		return events.DeleteBucket([]byte(id))
	})
	return wrap("delete job", err)
}

func deleteKeysOf(keys *bbolt.Bucket, id string) error {
	var stale [][]byte
	err := keys.ForEach(func(k, v []byte) error {
		var entry keyEntry
		if err := json.Unmarshal(v, &entry); err != nil {
			return err
		}
		if entry.Job == id {
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

// Jobs implements store.Store.
func (s *Store) Jobs(context.Context) ([]store.Record, error) {
	var records []store.Record
	err := s.db.View(func(tx *bbolt.Tx) error {
		return tx.Bucket(jobsBucket).ForEach(func(_, v []byte) error {
			var r store.Record
			if err := json.Unmarshal(v, &r); err != nil {
				return err
			}
			records = append(records, r)
			return nil
		})
	})
	slices.SortFunc(records, func(a, b store.Record) int { return int(a.Number) - int(b.Number) })
	return records, wrap("list jobs", err)
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

// update runs fn unless a newer owner has claimed the store.
func (s *Store) update(epoch uint64, fn func(*bbolt.Tx) error) error {
	return s.db.Update(func(tx *bbolt.Tx) error {
		if epoch != currentEpoch(tx) {
			return store.ErrFenced
		}
		return fn(tx)
	})
}

func currentEpoch(tx *bbolt.Tx) uint64 {
	v := tx.Bucket(metaBucket).Get(epochKey)
	if v == nil {
		return 0
	}
	return binary.BigEndian.Uint64(v)
}

func bigEndian(n uint64) []byte { return binary.BigEndian.AppendUint64(nil, n) }

func putJSON(b *bbolt.Bucket, key []byte, v any) error {
	content, err := json.Marshal(v)
	if err != nil {
		return err
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

func wrap(what string, err error) error {
	if err == nil {
		return nil
	}
	return fmt.Errorf("bolt: %s: %w", what, err)
}
