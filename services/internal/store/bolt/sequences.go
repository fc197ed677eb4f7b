package bolt

import (
	"context"
	"encoding/json"
	"fmt"
	"slices"

	"go.etcd.io/bbolt"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// sequenceEntry is a stored sequence.
type sequenceEntry struct {
	store.Sequence
	// Left is how many of its jobs there are.
	Left int `json:"left"`
}

// CreateSequence implements store.Store.
func (s *Store) CreateSequence(_ context.Context, c store.Claim, q store.Sequence, jobs []store.Record, key, fingerprint string) (stored store.Sequence, created bool, err error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	err = s.db.Update(func(tx *bbolt.Tx) error {
		id, err := findKey(tx, key, fingerprint)
		if err != nil {
			return err
		}
		if id == "" {
			id = q.ID // the same call again may find it
		}
		found, err := getSequence(tx, id, &stored)
		created = found && id == q.ID
		if err != nil || found {
			return err
		}
		stored, created = q, true
		return insertSequence(tx, &stored, jobs, key, fingerprint)
	})
	if err == nil && created {
		for _, id := range stored.Jobs {
			s.leases[id] = lease{c.Owner, s.now().Add(c.TTL)}
		}
	}
	return stored, created, wrap("create sequence", err)
}

func insertSequence(tx *bbolt.Tx, q *store.Sequence, jobs []store.Record, key, fingerprint string) error {
	for i, r := range jobs {
		if err := insertJob(tx, &r); err != nil {
			return err
		}
		if i == 0 {
			q.Number = r.Number
		}
	}
	if err := putKey(tx, key, q.ID, fingerprint); err != nil {
		return err
	}
	if err := tx.Bucket(sequenceOrderBucket).Put(bigEndian(q.Number), []byte(q.ID)); err != nil {
		return err
	}
	return putJSON(tx.Bucket(sequencesBucket), []byte(q.ID), sequenceEntry{*q, len(jobs)})
}

// leaveSequence takes a job that is deleted out of its sequence, which ends with the last one.
func leaveSequence(tx *bbolt.Tx, of *job.FrameOf) error {
	if of == nil {
		return nil
	}
	sequences, id := tx.Bucket(sequencesBucket), []byte(of.ID)
	var entry sequenceEntry
	if _, err := getJSON(sequences, id, &entry); err != nil {
		return err
	}
	if entry.Left--; entry.Left > 0 {
		return putJSON(sequences, id, entry)
	}
	if err := tx.Bucket(sequenceOrderBucket).Delete(bigEndian(entry.Number)); err != nil {
		return err
	}
	if err := deleteKeysOf(tx.Bucket(keysBucket), of.ID); err != nil {
		return err
	}
	return sequences.Delete(id)
}

// getSequence reads a sequence with the states of its jobs.
func getSequence(tx *bbolt.Tx, id string, into *store.Sequence) (bool, error) {
	var entry sequenceEntry
	found, err := getJSON(tx.Bucket(sequencesBucket), []byte(id), &entry)
	if err != nil || !found {
		return false, err
	}
	*into = entry.Sequence
	into.States = make([]job.State, len(into.Jobs))
	for i, id := range into.Jobs {
		r := struct {
			State job.State `json:"state"`
		}{job.Deleted}
		if content := tx.Bucket(jobsBucket).Get([]byte(id)); content != nil {
			if err := json.Unmarshal(content, &r); err != nil {
				return false, err
			}
		}
		into.States[i] = r.State
	}
	return true, nil
}

// Sequence implements store.Store.
func (s *Store) Sequence(_ context.Context, id string) (q store.Sequence, err error) {
	err = s.db.View(func(tx *bbolt.Tx) error {
		found, err := getSequence(tx, id, &q)
		if err == nil && !found {
			err = fmt.Errorf("sequence %s: %w", id, job.ErrNotFound)
		}
		return err
	})
	return q, wrap("get sequence", err)
}

// Sequences implements store.Store.
func (s *Store) Sequences(_ context.Context, before uint64, limit int) (all []store.Sequence, err error) {
	err = s.db.View(func(tx *bbolt.Tx) error {
		for _, id := range page(tx.Bucket(sequenceOrderBucket), before, limit) {
			var q store.Sequence
			if _, err := getSequence(tx, string(id), &q); err != nil {
				return err
			}
			all = append(all, q)
		}
		return nil
	})
	return all, wrap("list sequences", err)
}

// page returns up to limit values of a bucket with keys below before, the last first.
func page(bucket *bbolt.Bucket, before uint64, limit int) [][]byte {
	cursor := bucket.Cursor()
	k, v := cursor.Last()
	if before > 0 {
		if at, _ := cursor.Seek(bigEndian(before)); at != nil {
			k, v = cursor.Prev()
		}
	}
	var values [][]byte
	for ; k != nil && len(values) < limit; k, v = cursor.Prev() {
		values = append(values, slices.Clone(v))
	}
	return values
}
