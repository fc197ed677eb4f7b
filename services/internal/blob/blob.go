// Package blob keeps bytes in a directory: scene files named by their SHA-256, bundle manifests
// named by their digest, and named blobs such as checkpoints. A write is visible whole or not at
// all, and survives a crash once it has returned.
package blob

import (
	"context"
	"errors"
	"fmt"
	"io"
	"io/fs"
	"os"
	"path/filepath"
	"regexp"
)

// ErrNotFound: no blob of that name.
var ErrNotFound = errors.New("blob not found")

// ErrName: a name or digest that no blob can have.
var ErrName = errors.New("invalid blob name")

// ErrTooLarge: the content passed the limit that the caller set.
var ErrTooLarge = errors.New("content is larger than allowed")

// Store is a directory of blobs. Its methods may be called from several goroutines.
type Store struct {
	dir string
}

const (
	filesDir     = "files"
	manifestsDir = "manifests"
	namedDir     = "named"
	temporaryDir = "tmp"
)

// Open makes dir a blob store if it is not one yet. What interrupted writes left behind is removed,
// so only one process may have a store open.
func Open(dir string) (*Store, error) {
	s := &Store{dir: dir}
	if err := os.RemoveAll(s.path(temporaryDir)); err != nil {
		return nil, fmt.Errorf("blob: clear temporaries: %w", err)
	}
	for _, sub := range []string{filesDir, manifestsDir, namedDir, temporaryDir} {
		if err := os.MkdirAll(s.path(sub), 0o750); err != nil {
			return nil, fmt.Errorf("blob: open %s: %w", dir, err)
		}
	}
	return s, nil
}

func (s *Store) path(elements ...string) string {
	return filepath.Join(append([]string{s.dir}, elements...)...)
}

var namePattern = regexp.MustCompile(`^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$`)

// WriteBlob makes what fn writes the content of the blob name, replacing any earlier content in one
// step. If fn fails, the earlier content stays.
func (s *Store) WriteBlob(name string, fn func(io.Writer) error) error {
	if !namePattern.MatchString(name) {
		return fmt.Errorf("%w: %q", ErrName, name)
	}
	return s.writeAtomic(func(f *os.File) (string, error) {
		return s.path(namedDir, name), fn(f)
	})
}

// OpenBlob opens the blob name for reading; ErrNotFound if there is none.
func (s *Store) OpenBlob(name string) (io.ReadCloser, error) {
	if !namePattern.MatchString(name) {
		return nil, fmt.Errorf("%w: %q", ErrName, name)
	}
	return open(s.path(namedDir, name))
}

// DeleteBlob removes the blob name. A blob that does not exist is no error.
func (s *Store) DeleteBlob(name string) error {
	if !namePattern.MatchString(name) {
		return fmt.Errorf("%w: %q", ErrName, name)
	}
	if err := os.Remove(s.path(namedDir, name)); err != nil && !errors.Is(err, fs.ErrNotExist) {
		return fmt.Errorf("blob: delete: %w", err)
	}
	return nil
}

// BlobNames lists the named blobs.
func (s *Store) BlobNames() ([]string, error) {
	entries, err := os.ReadDir(s.path(namedDir))
	if err != nil {
		return nil, fmt.Errorf("blob: list: %w", err)
	}
	names := make([]string, 0, len(entries))
	for _, entry := range entries {
		names = append(names, entry.Name())
	}
	return names, nil
}

// writeAtomic lets fill write a temporary file and say where it belongs; the file is moved there
// once its bytes are on disk. A target that exists is replaced.
func (s *Store) writeAtomic(fill func(*os.File) (target string, err error)) error {
	f, err := os.CreateTemp(s.path(temporaryDir), "write-*")
	if err != nil {
		return fmt.Errorf("blob: %w", err)
	}
	defer os.Remove(f.Name()) // fails after the rename, as it should
	target, err := fill(f)
	if err == nil {
		err = f.Sync()
	}
	if closeErr := f.Close(); err == nil {
		err = closeErr
	}
	if err != nil {
		return fmt.Errorf("blob: write: %w", err)
	}
	if err := os.Rename(f.Name(), target); err != nil {
		return fmt.Errorf("blob: %w", err)
	}
	return syncDir(filepath.Dir(target))
}

// syncDir makes a rename in dir durable.
func syncDir(dir string) error {
	d, err := os.Open(dir)
	if err != nil {
		return fmt.Errorf("blob: %w", err)
	}
	defer d.Close()
	if err := d.Sync(); err != nil {
		return fmt.Errorf("blob: sync %s: %w", dir, err)
	}
	return nil
}

func open(path string) (io.ReadCloser, error) {
	f, err := os.Open(path)
	if errors.Is(err, fs.ErrNotExist) {
		return nil, fmt.Errorf("%w: %s", ErrNotFound, filepath.Base(path))
	}
	if err != nil {
		return nil, fmt.Errorf("blob: %w", err)
	}
	return f, nil
}

// contextReader stops a copy when its context ends.
type contextReader struct {
	ctx context.Context
	r   io.Reader
}

func (c contextReader) Read(p []byte) (int, error) {
	if err := c.ctx.Err(); err != nil {
		return 0, err
	}
	return c.r.Read(p)
}
