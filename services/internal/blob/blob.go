// Package blob keeps bytes: scene files named by their SHA-256, bundle manifests named by their
// digest, and named blobs such as checkpoints. A write is visible whole or not at all, and survives
// a crash once it has returned. Where the bytes lie is up to a Backend: package dir keeps them in a
// directory, package s3 in a bucket. Package blobtest has the conformance suite of both.
package blob

import (
	"context"
	"errors"
	"fmt"
	"io"
	"iter"
	"regexp"
	"time"
)

// ErrNotFound: no blob of that name.
var ErrNotFound = errors.New("blob not found")

// ErrName: a name or digest that no blob can have.
var ErrName = errors.New("invalid blob name")

// ErrTooLarge: the content passed the limit that the caller set.
var ErrTooLarge = errors.New("content is larger than allowed")

// ErrCorrupt: the content is not what its name says.
var ErrCorrupt = errors.New("content differs from its digest")

// Kind is one of the three families of blobs. Each has its own names.
type Kind string

const (
	// Files of scenes, named by the SHA-256 of their content.
	Files Kind = "files"
	// Manifests of bundles, named by their digest.
	Manifests Kind = "manifests"
	// Named blobs, such as checkpoints, have names that their writers choose.
	Named Kind = "named"
)

// Kinds lists all of them.
func Kinds() []Kind { return []Kind{Files, Manifests, Named} }

// Key is where a blob lies: a family and a name in it, one path component without a dot at its start.
type Key struct {
	Kind Kind
	Name string
}

// Info describes a blob.
type Info struct {
	Name string
	Size int64
	// Modified is when it was last written, by the backend's clock.
	Modified time.Time
}

// Backend keeps blobs for a Store, which checks names. Its methods may be called from several
// goroutines and, on the same place, from several processes. Content is opaque.
type Backend interface {
	// Write makes what fill writes the content of key, replacing any earlier content in one step, and
	// is durable when it returns. If fill or anything else fails, the earlier content stays.
	Write(ctx context.Context, key Key, fill func(io.Writer) error) error
	// Add is Write for content whose key is known at its end only: fill returns it.
	Add(ctx context.Context, fill func(io.Writer) (Key, error)) error
	// Open opens a blob for reading; ErrNotFound if there is none. The reader ends with ctx.
	Open(ctx context.Context, key Key) (io.ReadCloser, error)
	// Stat describes a blob; ErrNotFound if there is none.
	Stat(ctx context.Context, key Key) (Info, error)
	// Delete removes a blob. One that does not exist is no error.
	Delete(ctx context.Context, key Key) error
	// List describes all blobs of a kind, in no particular order. An error ends it.
	List(ctx context.Context, kind Kind) iter.Seq2[Info, error]
	// RemoveUnfinished removes what is left of writes that began before the given time and never
	// ended.
	RemoveUnfinished(ctx context.Context, before time.Time) error
}

// Store is what a backend holds. Its methods may be called from several goroutines.
type Store struct {
	backend Backend
}

// New returns the store of what the backend holds.
func New(backend Backend) *Store { return &Store{backend} }

var namePattern = regexp.MustCompile(`^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$`)

func keyOf(kind Kind, name string) (Key, error) {
	pattern := digestPattern
	if kind == Named {
		pattern = namePattern
	}
	if !pattern.MatchString(name) {
		return Key{}, fmt.Errorf("%w: %q", ErrName, name)
	}
	return Key{kind, name}, nil
}

// WriteBlob makes what fill writes the content of the blob name, replacing any earlier content in
// one step. If fill fails, the earlier content stays.
func (s *Store) WriteBlob(ctx context.Context, name string, fill func(io.Writer) error) error {
	key, err := keyOf(Named, name)
	if err != nil {
		return err
	}
	if err := s.backend.Write(ctx, key, fill); err != nil {
		return fmt.Errorf("writing blob %s: %w", name, err)
	}
	return nil
}

// OpenBlob opens the blob name for reading; ErrNotFound if there is none.
func (s *Store) OpenBlob(ctx context.Context, name string) (io.ReadCloser, error) {
	key, err := keyOf(Named, name)
	if err != nil {
		return nil, err
	}
	r, err := s.backend.Open(ctx, key)
	if err != nil {
		return nil, fmt.Errorf("opening blob %s: %w", name, err)
	}
	return r, nil
}

// Delete removes a blob. One that does not exist is no error.
func (s *Store) Delete(ctx context.Context, kind Kind, name string) error {
	key, err := keyOf(kind, name)
	if err != nil {
		return err
	}
	if err := s.backend.Delete(ctx, key); err != nil {
		return fmt.Errorf("deleting %s/%s: %w", kind, name, err)
	}
	return nil
}

// Stat describes a blob; ErrNotFound if there is none.
func (s *Store) Stat(ctx context.Context, kind Kind, name string) (Info, error) {
	key, err := keyOf(kind, name)
	if err != nil {
		return Info{}, err
	}
	info, err := s.backend.Stat(ctx, key)
	if err != nil {
		return Info{}, fmt.Errorf("looking at %s/%s: %w", kind, name, err)
	}
	return info, nil
}

// List describes all blobs of a kind, in no particular order. An error ends it. What has a name that
// no blob can have is not ours and is left out.
func (s *Store) List(ctx context.Context, kind Kind) iter.Seq2[Info, error] {
	return func(yield func(Info, error) bool) {
		for info, err := range s.backend.List(ctx, kind) {
			if err != nil {
				yield(Info{}, fmt.Errorf("listing %s: %w", kind, err))
				return
			}
			if _, err := keyOf(kind, info.Name); err == nil && !yield(info, nil) {
				return
			}
		}
	}
}

// RemoveUnfinished removes what is left of writes that began before the given time and never ended.
func (s *Store) RemoveUnfinished(ctx context.Context, before time.Time) error {
	if err := s.backend.RemoveUnfinished(ctx, before); err != nil {
		return fmt.Errorf("removing unfinished writes: %w", err)
	}
	return nil
}
