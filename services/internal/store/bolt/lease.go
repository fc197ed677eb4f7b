package bolt

import (
	"context"
	"fmt"
	"slices"
	"strings"
	"time"

	"go.etcd.io/bbolt"

	"metrofarm/services/internal/store"
)

// Beat implements store.Store.
func (s *Store) Beat(_ context.Context, m store.Member, ttl time.Duration, held map[string]uint64) (lost []string, err error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	until := s.now().Add(ttl)
	err = s.db.View(func(tx *bbolt.Tx) error {
		for id, epoch := range held {
			owns, err := s.owns(tx, m.ID, epoch, id)
			switch {
			case err != nil:
				return err
			case owns:
				s.leases[id] = lease{m.ID, until}
			default:
				lost = append(lost, id)
			}
		}
		return nil
	})
	if err == nil {
		s.members[m.ID] = membership{m, until}
	}
	return lost, wrap("beat", err)
}

// Leave implements store.Store.
func (s *Store) Leave(_ context.Context, member string, held map[string]uint64) error {
	s.mu.Lock()
	defer s.mu.Unlock()
	delete(s.members, member)
	err := s.db.View(func(tx *bbolt.Tx) error {
		for id, epoch := range held {
			owns, err := s.owns(tx, member, epoch, id)
			if err != nil {
				return err
			}
			if owns {
				delete(s.leases, id)
			}
		}
		return nil
	})
	return wrap("leave", err)
}

func (s *Store) owns(tx *bbolt.Tx, member string, epoch uint64, id string) (bool, error) {
	var o ownership
	found, err := getJSON(tx.Bucket(ownersBucket), []byte(id), &o)
	return found && o.Epoch == epoch && s.leases[id].owner == member, err
}

// Members implements store.Store.
func (s *Store) Members(context.Context) ([]store.Member, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	var members []store.Member
	for id, m := range s.members {
		if s.now().Before(m.until) {
			members = append(members, m.Member)
		} else {
			delete(s.members, id)
		}
	}
	slices.SortFunc(members, func(a, b store.Member) int { return strings.Compare(a.ID, b.ID) })
	return members, nil
}

// Release implements store.Store.
func (s *Store) Release(_ context.Context, epoch uint64, id string) error {
	s.mu.Lock()
	defer s.mu.Unlock()
	err := s.update(epoch, id, func(tx *bbolt.Tx, o *ownership) error {
		var r store.Record
		if _, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &r); err != nil {
			return err
		}
		o.Settled = r.State.Ended()
		return putJSON(tx.Bucket(ownersBucket), []byte(id), o)
	})
	if err == nil {
		delete(s.leases, id)
	}
	return wrap("release job", err)
}

// Waiting implements store.Store.
func (s *Store) Waiting(context.Context) ([]string, error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	var ids []string
	err := s.db.View(func(tx *bbolt.Tx) error {
		return tx.Bucket(orderBucket).ForEach(func(_, id []byte) error {
			var o ownership
			if _, err := getJSON(tx.Bucket(ownersBucket), id, &o); err != nil {
				return err
			}
			if !o.Settled && !s.live(string(id)) {
				ids = append(ids, string(id))
			}
			return nil
		})
	})
	return ids, wrap("list waiting jobs", err)
}

// Acquire implements store.Store.
func (s *Store) Acquire(_ context.Context, c store.Claim, id string) (r store.Record, epoch uint64, err error) {
	s.mu.Lock()
	defer s.mu.Unlock()
	err = s.db.Update(func(tx *bbolt.Tx) error {
		found, err := getJSON(tx.Bucket(jobsBucket), []byte(id), &r)
		switch {
		case err != nil:
			return err
		case !found:
			return notFound(id)
		case s.live(id) && s.leases[id].owner != c.Owner:
			return fmt.Errorf("job %s: %w", id, store.ErrOwned)
		}
		var o ownership
		if _, err := getJSON(tx.Bucket(ownersBucket), []byte(id), &o); err != nil {
			return err
		}
		epoch = o.Epoch + 1
		return putJSON(tx.Bucket(ownersBucket), []byte(id), ownership{Epoch: epoch})
	})
	if err != nil {
		return store.Record{}, 0, wrap("acquire job", err)
	}
	s.leases[id] = lease{c.Owner, s.now().Add(c.TTL)}
	return r, epoch, nil
}

// owner requires: mu.
func (s *Store) owner(id string) store.Member {
	if !s.live(id) {
		return store.Member{}
	}
	return s.members[s.leases[id].owner].Member
}

// live tells whether a job's lease lasts. Requires: mu.
func (s *Store) live(id string) bool { return s.now().Before(s.leases[id].until) }

// update runs fn on a job unless the caller does not own it any more. Requires: mu.
func (s *Store) update(epoch uint64, id string, fn func(*bbolt.Tx, *ownership) error) error {
	return s.db.Update(func(tx *bbolt.Tx) error {
		if tx.Bucket(jobsBucket).Get([]byte(id)) == nil {
			return notFound(id)
		}
		var o ownership
		if _, err := getJSON(tx.Bucket(ownersBucket), []byte(id), &o); err != nil {
			return err
		}
		if _, leased := s.leases[id]; !leased || o.Epoch != epoch {
			return fmt.Errorf("job %s: %w", id, store.ErrFenced)
		}
		return fn(tx, &o)
	})
}
