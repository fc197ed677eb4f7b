package blob

import (
	"context"
	"crypto/sha256"
	"encoding/hex"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"io/fs"
	"os"
	"regexp"
	"slices"
	"strings"
	"unicode/utf8"
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
// and leave nothing behind.
func (s *Store) PutFile(ctx context.Context, r io.Reader, limit int64) (sha string, size int64, err error) {
	err = s.writeAtomic(func(f *os.File) (string, error) {
		hash := sha256.New()
		limited := io.LimitReader(contextReader{ctx, r}, limit+1)
		var copyErr error
		if size, copyErr = io.Copy(io.MultiWriter(f, hash), limited); copyErr != nil {
			return "", copyErr
		}
		if size > limit {
			return "", fmt.Errorf("%w: limit %d bytes", ErrTooLarge, limit)
		}
		sha = hex.EncodeToString(hash.Sum(nil))
		return s.path(filesDir, sha), nil
	})
	if err != nil {
		return "", 0, err
	}
	return sha, size, nil
}

// OpenFile opens the file with the given SHA-256.
func (s *Store) OpenFile(sha string) (io.ReadCloser, error) {
	if !digestPattern.MatchString(sha) {
		return nil, fmt.Errorf("%w: %q", ErrName, sha)
	}
	return open(s.path(filesDir, sha))
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
	content, err := json.Marshal(sorted)
	if err != nil {
		return "", fmt.Errorf("blob: manifest: %w", err)
	}
	err = s.writeAtomic(func(f *os.File) (string, error) {
		_, err := f.Write(content)
		return s.path(manifestsDir, digest), err
	})
	return digest, err
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
func (s *Store) Manifest(digest string) ([]File, error) {
	if !digestPattern.MatchString(digest) {
		return nil, fmt.Errorf("%w: %q", ErrName, digest)
	}
	content, err := os.ReadFile(s.path(manifestsDir, digest))
	if errors.Is(err, fs.ErrNotExist) {
		return nil, fmt.Errorf("%w: bundle %s", ErrNotFound, digest)
	}
	if err != nil {
		return nil, fmt.Errorf("blob: manifest: %w", err)
	}
	var files []File
	if err := json.Unmarshal(content, &files); err != nil {
		return nil, fmt.Errorf("blob: manifest %s: %w", digest, err)
	}
	return files, nil
}

func (s *Store) checkFiles(ctx context.Context, sorted []File) error {
	if len(sorted) == 0 {
		return fmt.Errorf("%w: a bundle without files", ErrName)
	}
	for i, f := range sorted {
		if err := ctx.Err(); err != nil {
			return err
		}
		if !ValidPath(f.Path) {
			return fmt.Errorf("%w: bundle path %q", ErrName, f.Path)
		}
		if i > 0 && sorted[i-1].Path == f.Path {
			return fmt.Errorf("%w: bundle path %q appears twice", ErrName, f.Path)
		}
		if err := s.checkFile(f); err != nil {
			return err
		}
	}
	return nil
}

func (s *Store) checkFile(f File) error {
	if !digestPattern.MatchString(f.SHA256) {
		return fmt.Errorf("%w: digest %q of %s", ErrName, f.SHA256, f.Path)
	}
	info, err := os.Stat(s.path(filesDir, f.SHA256))
	if errors.Is(err, fs.ErrNotExist) {
		return fmt.Errorf("%w: content of %s", ErrNotFound, f.Path)
	}
	if err != nil {
		return fmt.Errorf("blob: %w", err)
	}
	if info.Size() != f.Size {
		return fmt.Errorf("%w: %s has %d bytes, not %d", ErrName, f.Path, info.Size(), f.Size)
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
