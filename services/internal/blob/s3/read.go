package s3

import (
	"context"
	"errors"
	"fmt"
	"io"

	"github.com/minio/minio-go/v7"
)

// maxResumes is how often in a row a download may break off without one byte read between.
const maxResumes = 3

// reader downloads an object. A connection that breaks is replaced by one that goes on at the byte
// where the last one ended: an image of hours of work must not be given up for it.
type reader struct {
	ctx     context.Context
	backend *Backend
	object  string
	etag    string
	size    int64
	offset  int64
	body    io.ReadCloser
	broken  int
}

func (b *Backend) open(ctx context.Context, object string) (io.ReadCloser, error) {
	core := minio.Core{Client: b.client}
	body, info, _, err := core.GetObject(ctx, b.options.Bucket, object, minio.GetObjectOptions{})
	if err != nil {
		return nil, b.explain("read", err)
	}
	return &reader{ctx: ctx, backend: b, object: object, etag: info.ETag, size: info.Size, body: body}, nil
}

// Read implements io.Reader.
func (r *reader) Read(p []byte) (int, error) {
	n, err := r.body.Read(p)
	r.offset += int64(n)
	if n > 0 {
		r.broken = 0
	}
	if err == nil || errors.Is(err, io.EOF) && r.offset == r.size {
		return n, err
	}
	if err := r.ctx.Err(); err != nil {
		return n, err
	}
	if r.broken++; r.broken > maxResumes {
		return n, fmt.Errorf("download broke off at byte %d of %d: %w", r.offset, r.size, err)
	}
	return n, r.resume()
}

func (r *reader) resume() error {
	if r.offset == r.size {
		return io.EOF // only the end of the connection was lost
	}
	options := minio.GetObjectOptions{}
	if err := errors.Join(options.SetRange(r.offset, r.size-1), options.SetMatchETag(r.etag)); err != nil {
		return err
	}
	core := minio.Core{Client: r.backend.client}
	body, _, _, err := core.GetObject(r.ctx, r.backend.options.Bucket, r.object, options)
	if err != nil {
		return fmt.Errorf("download broke off at byte %d of %d: %w", r.offset, r.size, r.backend.explain("read", err))
	}
	_ = r.body.Close() // it has failed already
	r.body = body
	return nil
}

// Close implements io.Closer.
func (r *reader) Close() error { return r.body.Close() }
