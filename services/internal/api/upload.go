package api

import (
	"errors"
	"fmt"
	"io"
	"os"
	"time"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/bundle"
)

// errSlow: an upload that may not take its place any longer.
var errSlow = errors.New("the upload is too slow")

// uploadReader reads the body of an upload. It may take as long as it likes while it makes progress: there
// are few places for uploads, and nobody may hold one for nothing.
type uploadReader struct {
	body    io.Reader
	setTime func(time.Time) error // deadline of a read; recorders in tests have none
	limits  Limits
	scenes  bundle.Limits
	read    int64
	waited  time.Duration // for what was read
}

func (s *server) newUploadReader(ctx huma.Context) *uploadReader {
	return &uploadReader{body: ctx.BodyReader(), setTime: ctx.SetReadDeadline, limits: s.Limits, scenes: s.Scenes.Limits()}
}

// Read implements io.Reader. What we do with the content in between is not the client's time.
func (u *uploadReader) Read(p []byte) (int, error) {
	earned := time.Duration(float64(u.read) / float64(u.limits.UploadRate) * float64(time.Second))
	left := min(u.limits.UploadPatience+earned-u.waited, u.limits.UploadPatience)
	start := time.Now()
	_ = u.setTime(start.Add(left))
	n, err := u.body.Read(p)
	u.waited += time.Since(start)
	u.read += int64(n)
	if errors.Is(err, os.ErrDeadlineExceeded) {
		return n, fmt.Errorf("%w: nothing came for %s, or less than %d bytes per second for longer", errSlow,
			u.limits.UploadPatience, u.limits.UploadRate)
	}
	if errors.Is(err, io.EOF) {
		// The server goes on reading, to see whether the client is there: a deadline would end the request
		// while the bundle is unpacked.
		_ = u.setTime(time.Time{})
	}
	if large := u.scenes.CheckUpload(u.read - formOverhead); large != nil {
		return 0, large
	}
	return n, err
}
