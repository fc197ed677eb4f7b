package s3_test

import (
	"errors"
	"io"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"github.com/minio/minio-go/v7"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/blobtest"
	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/blob/s3/s3test"
)

func TestConformance(t *testing.T) {
	server := s3test.Start(t)
	blobtest.Run(t, func(t *testing.T) func() blob.Backend {
		t.Helper()
		options := server.Bucket()
		return func() blob.Backend { return open(t, options) }
	})
}

func open(t *testing.T, options s3.Options) *s3.Backend {
	t.Helper()
	b, err := s3.Open(t.Context(), options)
	if err != nil {
		t.Fatal(err)
	}
	return b
}

const name = "checkpoint-1"

func write(t *testing.T, s *blob.Store, content string) {
	t.Helper()
	err := s.WriteBlob(t.Context(), name, func(w io.Writer) error {
		_, err := io.WriteString(w, content)
		return err
	})
	if err != nil {
		t.Fatal(err)
	}
}

func expect(t *testing.T, s *blob.Store, want string) {
	t.Helper()
	r, err := s.OpenBlob(t.Context(), name)
	if err != nil {
		t.Fatal(err)
	}
	defer r.Close()
	if got, err := io.ReadAll(r); err != nil || string(got) != want {
		t.Errorf("read %d bytes, %v; want %d", len(got), err, len(want))
	}
}

// megabytes of a checkpoint: several parts.
func megabytes(n int, fill string) string { return strings.Repeat(fill, n<<20) }

func TestAKilledServerKeepsTheOldContent(t *testing.T) {
	server := s3test.Start(t)
	s := blob.New(open(t, server.Bucket()))
	old := megabytes(18, "o")
	write(t, s, old)
	err := s.WriteBlob(t.Context(), name, func(w io.Writer) error {
		// The first part has arrived and the second is on its way.
		_, err := io.WriteString(w, megabytes(20, "n"))
		server.Kill()
		_, more := io.WriteString(w, megabytes(20, "n"))
		return errors.Join(err, more)
	})
	if err == nil || !strings.Contains(err.Error(), "--s3-endpoint") {
		t.Errorf("writing to a dead server: %v", err)
	}
	server.Restart()
	expect(t, s, old)
	write(t, s, "new")
	expect(t, s, "new")
}

func TestARestartIsRiddenOut(t *testing.T) {
	server := s3test.Start(t)
	s := blob.New(open(t, server.Bucket()))
	content := megabytes(40, "c")
	err := s.WriteBlob(t.Context(), name, func(w io.Writer) error {
		_, err := io.WriteString(w, content[:20<<20])
		server.Kill()
		server.Restart()
		_, more := io.WriteString(w, content[20<<20:])
		return errors.Join(err, more)
	})
	if err != nil {
		t.Fatal(err)
	}
	expect(t, s, content)

	r, err := s.OpenBlob(t.Context(), name)
	if err != nil {
		t.Fatal(err)
	}
	defer r.Close()
	start := make([]byte, 1<<20)
	if _, err := io.ReadFull(r, start); err != nil {
		t.Fatal(err)
	}
	server.Kill()
	server.Restart()
	rest, err := io.ReadAll(r)
	if err != nil || string(start)+string(rest) != content {
		t.Errorf("%d bytes after the restart: %v", len(rest), err)
	}
}

func TestUnfinishedUploadsAreRemovedWhenOld(t *testing.T) {
	server := s3test.Start(t)
	options := server.Bucket()
	b := open(t, options)
	core := minio.Core{Client: server.Client()}
	object := options.Prefix + "/named/half"
	id, err := core.NewMultipartUpload(t.Context(), options.Bucket, object, minio.PutObjectOptions{})
	if err != nil {
		t.Fatal(err)
	}
	count := func() int {
		page, err := core.ListMultipartUploads(t.Context(), options.Bucket, options.Prefix+"/", "", "", "", 100)
		if err != nil {
			t.Fatal(err)
		}
		return len(page.Uploads)
	}
	for _, c := range []struct {
		before time.Time
		want   int
	}{{time.Now().Add(-time.Hour), 1}, {time.Now().Add(time.Hour), 0}} {
		if err := b.RemoveUnfinished(t.Context(), c.before); err != nil {
			t.Fatal(err)
		}
		if got := count(); got != c.want {
			t.Errorf("%d uploads of %s are left, want %d", got, id, c.want)
		}
	}
}

func TestWithoutPrefix(t *testing.T) {
	server := s3test.Start(t)
	options := server.Bucket()
	options.Prefix = ""
	s := blob.New(open(t, options))
	write(t, s, "x")
	for info, err := range s.List(t.Context(), blob.Named) {
		if err != nil || info.Name != name {
			t.Errorf("listed %+v, %v", info, err)
		}
	}
	if err := s.RemoveUnfinished(t.Context(), time.Now()); err != nil {
		t.Error(err)
	}
	if _, err := server.Client().StatObject(t.Context(), options.Bucket, "named/"+name, minio.StatObjectOptions{}); err != nil {
		t.Error(err)
	}
}

func TestErrorsNameTheSetting(t *testing.T) {
	server := s3test.Start(t)
	good := server.Bucket()
	stranger := server.User(t.Context(), "stranger")
	for name, c := range map[string]struct {
		change func(*s3.Options)
		want   []string
	}{
		"no bucket":  {func(o *s3.Options) { o.Bucket = "missing" }, []string{`"missing"`, "--blobs"}},
		"no right":   {func(o *s3.Options) { o.Credentials = stranger }, []string{"access denied", "AWS_ACCESS_KEY_ID", good.Bucket}},
		"wrong key":  {func(o *s3.Options) { o.Credentials.AccessKey = "nobody" }, []string{"AWS_ACCESS_KEY_ID"}},
		"wrong word": {func(o *s3.Options) { o.Credentials.SecretKey = "wrong" }, []string{"AWS_SECRET_ACCESS_KEY"}},
		"region":     {func(o *s3.Options) { o.Region = "mars-1" }, []string{"--s3-region"}},
		"endpoint":   {func(o *s3.Options) { o.Endpoint = "http://127.0.0.1:1" }, []string{"--s3-endpoint"}},
		"no URL":     {func(o *s3.Options) { o.Endpoint = "127.0.0.1:1" }, []string{"http://HOST:PORT"}},
	} {
		t.Run(name, func(t *testing.T) {
			t.Parallel()
			options := good
			c.change(&options)
			_, err := s3.Open(t.Context(), options)
			if err == nil {
				t.Fatal("opened")
			}
			for _, want := range append(c.want, "s3://"+options.Bucket) {
				if !strings.Contains(err.Error(), want) {
					t.Errorf("error %q does not say %s", err, want)
				}
			}
			if strings.Contains(err.Error(), good.Credentials.SecretKey) {
				t.Errorf("error %q tells the secret", err)
			}
		})
	}
}

func TestNothingIsLeftInTheSpool(t *testing.T) {
	server := s3test.Start(t)
	options := server.Bucket()
	s := blob.New(open(t, options))
	if _, _, err := s.PutFile(t.Context(), strings.NewReader("12345"), 5); err != nil {
		t.Error(err)
	}
	if _, _, err := s.PutFile(t.Context(), strings.NewReader("12345"), 4); !errors.Is(err, blob.ErrTooLarge) {
		t.Error(err)
	}
	if left, err := filepath.Glob(filepath.Join(options.SpoolDir, "*")); err != nil || len(left) != 0 {
		t.Errorf("left %v, %v", left, err)
	}
	if err := os.Remove(options.SpoolDir); err != nil {
		t.Fatal(err)
	}
	if _, _, err := s.PutFile(t.Context(), strings.NewReader("1"), 5); err == nil {
		t.Error("stored without a place to hold the content")
	}
}
