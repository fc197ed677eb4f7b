// Package s3 keeps blobs in a bucket of an S3-compatible store: one object per blob, named by its
// kind and name below a prefix.
package s3

import (
	"bytes"
	"context"
	"errors"
	"fmt"
	"io"
	"iter"
	"os"
	"path"
	"strings"
	"time"

	"github.com/minio/minio-go/v7"

	"metrofarm/services/internal/blob"
)

const (
	// partBytes is the size of an upload's parts, and so the memory that one upload takes.
	partBytes = 16 << 20
	// smallBytes is up to where a blob goes up in one request instead of the three of an upload in
	// parts.
	smallBytes = 1 << 20
	// An upload has at most 10,000 parts. The client would end it there without an error, so a stream
	// must end before.
	maxStreamBytes = 9_999 * partBytes
)

// Backend is a bucket, or the part of it below a prefix.
type Backend struct {
	client   *minio.Client
	options  Options
	maxBytes int64 // of a stream of unknown length
}

var _ blob.Backend = (*Backend)(nil)

// Open connects to the bucket and tries whether it may be listed, written and read: what is missing
// shows now and not at the first checkpoint.
func Open(ctx context.Context, options Options) (*Backend, error) {
	client, err := options.client()
	if err != nil {
		return nil, fmt.Errorf("blobs in %s: %w", options.location(), err)
	}
	b := &Backend{client: client, options: options, maxBytes: maxStreamBytes}
	if err := b.try(ctx); err != nil {
		return nil, fmt.Errorf("blobs in %s: %w", options.location(), err)
	}
	return b, nil
}

func (b *Backend) try(ctx context.Context) error {
	if err := b.tryList(ctx); err != nil {
		return err
	}
	probe := b.path("probe")
	const content = "may be written and read"
	if err := b.put(ctx, probe, strings.NewReader(content), int64(len(content))); err != nil {
		return err
	}
	r, err := b.open(ctx, probe)
	if err != nil {
		return err
	}
	got, err := io.ReadAll(r)
	if err = errors.Join(err, r.Close()); err != nil {
		return err
	}
	if string(got) != content {
		return fmt.Errorf("object %s reads as other bytes than were written", probe)
	}
	return nil
}

func (b *Backend) tryList(ctx context.Context) error {
	ctx, cancel := context.WithCancel(ctx)
	defer cancel()
	for info := range b.list(ctx, b.path("probe")) {
		return b.explain("list", info.Err)
	}
	return nil
}

func (b *Backend) path(elements ...string) string {
	return path.Join(append([]string{b.options.Prefix}, elements...)...)
}

// folder is what the names of all objects in it begin with.
func (b *Backend) folder(elements ...string) string {
	if joined := b.path(elements...); joined != "" {
		return joined + "/"
	}
	return ""
}

func (b *Backend) object(key blob.Key) string { return b.path(string(key.Kind), key.Name) }

// Write implements blob.Backend: what fill writes is uploaded in parts meanwhile, and the object
// changes when the last part has arrived.
func (b *Backend) Write(ctx context.Context, key blob.Key, fill func(io.Writer) error) error {
	r, w := io.Pipe()
	uploaded := make(chan error, 1)
	go func() {
		err := b.upload(ctx, b.object(key), r)
		r.CloseWithError(err) // fill must not wait for a reader that has gone
		uploaded <- err
	}()
	filled := fill(w)
	w.CloseWithError(filled)
	if err := <-uploaded; err != nil {
		return err
	}
	return filled
}

// upload stores a stream of unknown length.
func (b *Backend) upload(ctx context.Context, object string, r io.Reader) error {
	var start bytes.Buffer
	switch _, err := io.CopyN(&start, r, smallBytes); {
	case errors.Is(err, io.EOF):
		return b.put(ctx, object, bytes.NewReader(start.Bytes()), int64(start.Len()))
	case err != nil:
		return err
	}
	return b.put(ctx, object, &boundedReader{io.MultiReader(&start, r), b.maxBytes}, -1)
}

func (b *Backend) put(ctx context.Context, object string, r io.Reader, size int64) error {
	options := minio.PutObjectOptions{}
	if size < 0 {
		options.PartSize = partBytes
	}
	_, err := b.client.PutObject(ctx, b.options.Bucket, object, r, size, options)
	return b.explain("write", err)
}

// boundedReader fails when there is more than allowed.
type boundedReader struct {
	r    io.Reader
	left int64
}

func (b *boundedReader) Read(p []byte) (int, error) {
	n, err := b.r.Read(p)
	if b.left -= int64(n); b.left < 0 {
		return 0, blob.ErrTooLarge
	}
	return n, err
}

// Add implements blob.Backend. The content waits in a local file for its key, which an upload needs
// from the start.
func (b *Backend) Add(ctx context.Context, fill func(io.Writer) (blob.Key, error)) error {
	f, err := os.CreateTemp(b.options.SpoolDir, "blob-*")
	if err != nil {
		return fmt.Errorf("holding the content: %w", err)
	}
	defer os.Remove(f.Name())
	defer f.Close()
	key, err := fill(f)
	if err != nil {
		return err
	}
	size, err := f.Seek(0, io.SeekEnd)
	if err == nil {
		_, err = f.Seek(0, io.SeekStart)
	}
	if err != nil {
		return fmt.Errorf("holding the content: %w", err)
	}
	return b.put(ctx, b.object(key), f, size)
}

// Open implements blob.Backend.
func (b *Backend) Open(ctx context.Context, key blob.Key) (io.ReadCloser, error) {
	return b.open(ctx, b.object(key))
}

// Stat implements blob.Backend.
func (b *Backend) Stat(ctx context.Context, key blob.Key) (blob.Info, error) {
	info, err := b.client.StatObject(ctx, b.options.Bucket, b.object(key), minio.StatObjectOptions{})
	if err != nil {
		return blob.Info{}, b.explain("read", err)
	}
	return describe(info), nil
}

func describe(info minio.ObjectInfo) blob.Info {
	return blob.Info{Name: path.Base(info.Key), Size: info.Size, Modified: info.LastModified}
}

// Delete implements blob.Backend.
func (b *Backend) Delete(ctx context.Context, key blob.Key) error {
	err := b.explain("delete", b.client.RemoveObject(ctx, b.options.Bucket, b.object(key), minio.RemoveObjectOptions{}))
	if errors.Is(err, blob.ErrNotFound) {
		return nil
	}
	return err
}

// List implements blob.Backend.
func (b *Backend) List(ctx context.Context, kind blob.Kind) iter.Seq2[blob.Info, error] {
	return func(yield func(blob.Info, error) bool) {
		ctx, cancel := context.WithCancel(ctx)
		defer cancel()
		for info := range b.list(ctx, b.folder(string(kind))) {
			if info.Err != nil {
				yield(blob.Info{}, b.explain("list", info.Err))
				return
			}
			if !yield(describe(info), nil) {
				return
			}
		}
	}
}

func (b *Backend) list(ctx context.Context, prefix string) iter.Seq[minio.ObjectInfo] {
	return b.client.ListObjectsIter(ctx, b.options.Bucket, minio.ListObjectsOptions{Prefix: prefix, Recursive: true})
}

// RemoveUnfinished implements blob.Backend: the parts of uploads that never ended take space and are
// in no listing.
func (b *Backend) RemoveUnfinished(ctx context.Context, before time.Time) error {
	core := minio.Core{Client: b.client}
	keyMarker, idMarker := "", ""
	for {
		page, err := core.ListMultipartUploads(ctx, b.options.Bucket, b.folder(), keyMarker, idMarker, "", 1000)
		if err != nil {
			return b.explain("list unfinished uploads", err)
		}
		for _, upload := range page.Uploads {
			if !upload.Initiated.Before(before) {
				continue
			}
			err := core.AbortMultipartUpload(ctx, b.options.Bucket, upload.Key, upload.UploadID)
			if err := b.explain("delete", err); err != nil && !errors.Is(err, blob.ErrNotFound) {
				return err
			}
		}
		if !page.IsTruncated {
			return nil
		}
		keyMarker, idMarker = page.NextKeyMarker, page.NextUploadIDMarker
	}
}
