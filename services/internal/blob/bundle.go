package blob

import (
	"context"
	"crypto/sha256"
	"encoding/hex"
	"encoding/json"
	"errors"
	"fmt"
	"hash"
	"io"
	"regexp"
	"slices"
	"strings"
	"unicode/utf8"

	"golang.org/x/sync/errgroup"
)

// File is one entry of a bundle's manifest.
type File struct {
	// Path inside the bundle: '/'-separated, no empty, "." or ".." component.
	Path string `json:"path"`
	// Size in bytes.
	Size int64 `json:"size"`
	// SHA256 of the content, 64 lower-case hex digits.
	SHA256 string `json:"sha256"`
}

const maxPathBytes = 1024

var digestPattern = regexp.MustCompile(`^[0-9a-f]{64}$`)

// PutFile stores the content of r under its SHA-256. More than limit bytes fail with ErrTooLarge
// and leave nothing behind. A file that is stored already is written again: that renews its time,
// by which unused ones are told, and mends a damaged one.
func (s *Store) PutFile(ctx context.Context, r io.Reader, limit int64) (sha string, size int64, err error) {
	err = s.backend.Add(ctx, func(w io.Writer) (Key, error) {
		hash := sha256.New()
		limited := io.LimitReader(contextReader{ctx, r}, limit+1)
		var copyErr error
		if size, copyErr = io.Copy(io.MultiWriter(w, hash), limited); copyErr != nil {
			return Key{}, copyErr
		}
		if size > limit {
			return Key{}, fmt.Errorf("%w: limit %d bytes", ErrTooLarge, limit)
		}
		sha = hex.EncodeToString(hash.Sum(nil))
		return Key{Files, sha}, nil
	})
	if err != nil {
		return "", 0, fmt.Errorf("storing a file: %w", err)
	}
	return sha, size, nil
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

// OpenFile opens the file with the given SHA-256. Where its content ends, reading fails with
// ErrCorrupt if it was another.
func (s *Store) OpenFile(ctx context.Context, sha string) (io.ReadCloser, error) {
	key, err := keyOf(Files, sha)
	if err != nil {
		return nil, err
	}
	r, err := s.backend.Open(ctx, key)
	if err != nil {
		return nil, fmt.Errorf("opening file %s: %w", sha, err)
	}
	return &checkedReader{r, sha256.New(), sha}, nil
}

// checkedReader compares what it read with its digest at the end.
type checkedReader struct {
	io.ReadCloser
	hash hash.Hash
	want string
}

func (c *checkedReader) Read(p []byte) (int, error) {
	n, err := c.ReadCloser.Read(p)
	c.hash.Write(p[:n])
	if errors.Is(err, io.EOF) {
		if got := hex.EncodeToString(c.hash.Sum(nil)); got != c.want {
			return n, fmt.Errorf("%w: file %s has SHA-256 %s", ErrCorrupt, c.want, got)
		}
	}
	return n, err
}

// PutManifest stores a bundle whose files are all stored and returns its digest: the SHA-256 of the
// lines "<sha256> <size> <path>\n" in ascending byte order of path.
func (s *Store) PutManifest(ctx context.Context, files []File) (digest string, err error) {
	sorted := slices.Clone(files)
	slices.SortFunc(sorted, func(a, b File) int { return strings.Compare(a.Path, b.Path) })
	if err := s.checkFiles(ctx, sorted); err != nil {
		return "", err
	}
	digest = Digest(sorted)
	if err := s.writeManifest(ctx, digest, sorted); err != nil {
		return "", err
	}
	return digest, nil
}

func (s *Store) writeManifest(ctx context.Context, digest string, sorted []File) error {
	content, err := json.Marshal(sorted)
	if err == nil {
		err = s.backend.Write(ctx, Key{Manifests, digest}, func(w io.Writer) error {
			_, err := w.Write(content)
			return err
		})
	}
	if err != nil {
		return fmt.Errorf("writing manifest %s: %w", digest, err)
	}
	return nil
}

// Digest of files that are in ascending order of path.
func Digest(files []File) string {
	hash := sha256.New()
	for _, f := range files {
		fmt.Fprintf(hash, "%s %d %s\n", f.SHA256, f.Size, f.Path)
	}
	return hex.EncodeToString(hash.Sum(nil))
}

// Manifest returns the files of a bundle in ascending order of path; ErrNotFound if there is no
// such bundle.
func (s *Store) Manifest(ctx context.Context, digest string) ([]File, error) {
	key, err := keyOf(Manifests, digest)
	if err != nil {
		return nil, err
	}
	files, err := s.readManifest(ctx, key)
	if err != nil {
		return nil, fmt.Errorf("reading manifest %s: %w", digest, err)
	}
	return files, nil
}

// UseManifest is Manifest for those who are about to refer to the bundle: it renews the time by
// which unused bundles are told.
func (s *Store) UseManifest(ctx context.Context, digest string) ([]File, error) {
	files, err := s.Manifest(ctx, digest)
	if err != nil {
		return nil, err
	}
	return files, s.writeManifest(ctx, digest, files)
}

func (s *Store) readManifest(ctx context.Context, key Key) ([]File, error) {
	r, err := s.backend.Open(ctx, key)
	if err != nil {
		return nil, err
	}
	defer r.Close()
	content, err := io.ReadAll(r)
	if err != nil {
		return nil, err
	}
	var files []File
	if err := json.Unmarshal(content, &files); err != nil {
		return nil, fmt.Errorf("%w: %w", ErrCorrupt, err)
	}
	if got := Digest(files); got != key.Name {
		return nil, fmt.Errorf("%w: its digest is %s", ErrCorrupt, got)
	}
	return files, nil
}

func (s *Store) checkFiles(ctx context.Context, sorted []File) error {
	if len(sorted) == 0 {
		return fmt.Errorf("%w: a bundle without files", ErrName)
	}
	for i, f := range sorted {
		if !ValidPath(f.Path) {
			return fmt.Errorf("%w: bundle path %q", ErrName, f.Path)
		}
		if i > 0 && sorted[i-1].Path == f.Path {
			return fmt.Errorf("%w: bundle path %q appears twice", ErrName, f.Path)
		}
	}
	// One question at a time would take minutes for thousands of files in a bucket far away.
	group, ctx := errgroup.WithContext(ctx)
	group.SetLimit(statsAtOnce)
	for _, f := range sorted {
		group.Go(func() error { return s.checkFile(ctx, f) })
	}
	return group.Wait()
}

// statsAtOnce bounds the questions under way for one manifest.
const statsAtOnce = 16

func (s *Store) checkFile(ctx context.Context, f File) error {
	info, err := s.Stat(ctx, Files, f.SHA256)
	if err != nil {
		return fmt.Errorf("content of %s: %w", f.Path, err)
	}
	if info.Size != f.Size {
		return fmt.Errorf("%w: %s has %d bytes, not %d", ErrName, f.Path, info.Size, f.Size)
	}
	return nil
}

// ValidPath tells whether path may name a file in a bundle. Control characters are refused as well:
// a newline would let two manifests share a canonical text.
func ValidPath(path string) bool {
	if path == "" || len(path) > maxPathBytes || !utf8.ValidString(path) {
		return false
	}
	if strings.ContainsFunc(path, func(r rune) bool { return r < 0x20 || r == 0x7f || r == '\\' }) {
		return false
	}
	for component := range strings.SplitSeq(path, "/") {
		if component == "" || component == "." || component == ".." {
			return false
		}
	}
	return true
}
