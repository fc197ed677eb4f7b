// Package dir keeps blobs in a directory: one file per blob, in one folder per kind.
package dir

import (
	"context"
	"errors"
	"fmt"
	"io"
	"io/fs"
	"iter"
	"os"
	"path/filepath"
	"time"

	"metrofarm/services/internal/blob"
)

// temporaryDir holds files while they are written. It lies beside the kinds, on the same file
// system, so that a rename puts a file where it belongs.
const temporaryDir = "tmp"

// listAtOnce is how many entries of a folder are read at a time.
const listAtOnce = 512

// Backend is a directory of blobs.
type Backend struct {
	dir string
}

var _ blob.Backend = (*Backend)(nil)

// Open makes dir a place for blobs if it is not one yet.
func Open(dir string) (*Backend, error) {
	b := &Backend{dir}
	folders := []string{temporaryDir}
	for _, kind := range blob.Kinds() {
		folders = append(folders, string(kind))
	}
	for _, folder := range folders {
		if err := os.MkdirAll(filepath.Join(dir, folder), 0o750); err != nil {
			return nil, fmt.Errorf("blobs: %w", err)
		}
	}
	return b, nil
}

func (b *Backend) path(key blob.Key) string {
	return filepath.Join(b.dir, string(key.Kind), key.Name)
}

// Write implements blob.Backend.
func (b *Backend) Write(ctx context.Context, key blob.Key, fill func(io.Writer) error) error {
	return b.Add(ctx, func(w io.Writer) (blob.Key, error) { return key, fill(w) })
}

// Add implements blob.Backend: a temporary file is filled, made durable, renamed, and the rename
// made durable.
func (b *Backend) Add(ctx context.Context, fill func(io.Writer) (blob.Key, error)) error {
	f, err := os.CreateTemp(filepath.Join(b.dir, temporaryDir), "write-*")
	if err != nil {
		return err
	}
	defer os.Remove(f.Name()) // fails after the rename, as it should
	key, err := fill(contextWriter{ctx, f})
	if err == nil {
		err = f.Sync()
	}
	if closeErr := f.Close(); err == nil {
		err = closeErr
	}
	if err != nil {
		return err
	}
	if err := ctx.Err(); err != nil {
		return err
	}
	target := b.path(key)
	if err := os.Rename(f.Name(), target); err != nil {
		return err
	}
	return syncDir(filepath.Dir(target))
}

// contextWriter stops a write when its context ends.
type contextWriter struct {
	ctx context.Context
	w   io.Writer
}

func (c contextWriter) Write(p []byte) (int, error) {
	if err := c.ctx.Err(); err != nil {
		return 0, err
	}
	return c.w.Write(p)
}

func syncDir(dir string) error {
	d, err := os.Open(dir)
	if err != nil {
		return err
	}
	defer d.Close()
	return d.Sync()
}

// Open implements blob.Backend.
func (b *Backend) Open(ctx context.Context, key blob.Key) (io.ReadCloser, error) {
	if err := ctx.Err(); err != nil {
		return nil, err
	}
	f, err := os.Open(b.path(key))
	if err != nil {
		return nil, notFound(err)
	}
	return &contextFile{f, ctx}, nil
}

// contextFile stops a reader when its context ends.
type contextFile struct {
	*os.File
	ctx context.Context
}

func (c *contextFile) Read(p []byte) (int, error) {
	if err := c.ctx.Err(); err != nil {
		return 0, err
	}
	return c.File.Read(p)
}

// Stat implements blob.Backend.
func (b *Backend) Stat(ctx context.Context, key blob.Key) (blob.Info, error) {
	if err := ctx.Err(); err != nil {
		return blob.Info{}, err
	}
	info, err := os.Stat(b.path(key))
	if err != nil {
		return blob.Info{}, notFound(err)
	}
	return describe(info), nil
}

func describe(info fs.FileInfo) blob.Info {
	return blob.Info{Name: info.Name(), Size: info.Size(), Modified: info.ModTime()}
}

func notFound(err error) error {
	if errors.Is(err, fs.ErrNotExist) {
		return blob.ErrNotFound
	}
	return err
}

// Delete implements blob.Backend.
func (b *Backend) Delete(ctx context.Context, key blob.Key) error {
	if err := ctx.Err(); err != nil {
		return err
	}
	return ignoreMissing(os.Remove(b.path(key)))
}

func ignoreMissing(err error) error {
	if errors.Is(err, fs.ErrNotExist) {
		return nil
	}
	return err
}

// List implements blob.Backend.
func (b *Backend) List(ctx context.Context, kind blob.Kind) iter.Seq2[blob.Info, error] {
	return func(yield func(blob.Info, error) bool) {
		err := b.each(ctx, string(kind), func(info fs.FileInfo) bool { return yield(describe(info), nil) })
		if err != nil {
			yield(blob.Info{}, err)
		}
	}
}

// each visits the files of a folder until visit returns false. Files that go away meanwhile are left
// out.
func (b *Backend) each(ctx context.Context, folder string, visit func(fs.FileInfo) bool) error {
	d, err := os.Open(filepath.Join(b.dir, folder))
	if err != nil {
		return err
	}
	defer d.Close()
	for {
		entries, err := d.ReadDir(listAtOnce)
		if errors.Is(err, io.EOF) {
			return nil
		}
		if err = errors.Join(err, ctx.Err()); err != nil {
			return err
		}
		for _, entry := range entries {
			info, err := entry.Info()
			if errors.Is(err, fs.ErrNotExist) {
				continue
			}
			if err != nil {
				return err
			}
			if !visit(info) {
				return nil
			}
		}
	}
}

// RemoveUnfinished implements blob.Backend. A temporary file's time is that of its last write, so one
// that is being written is not old.
func (b *Backend) RemoveUnfinished(ctx context.Context, before time.Time) error {
	var failed error
	err := b.each(ctx, temporaryDir, func(info fs.FileInfo) bool {
		if info.ModTime().Before(before) {
			failed = ignoreMissing(os.Remove(filepath.Join(b.dir, temporaryDir, info.Name())))
		}
		return failed == nil
	})
	return errors.Join(err, failed)
}
