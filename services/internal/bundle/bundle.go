// Package bundle brings the files of scenes into the blob store: from an uploaded archive, which is
// not trusted, or from files on this machine.
package bundle

import (
	"cmp"
	"context"
	"errors"
	"fmt"
	"io"
	"iter"
	"path"
	"slices"
	"strings"
	"time"

	"github.com/dustin/go-humanize"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/job"
)

// ErrTooLarge: an upload passes one of the limits.
var ErrTooLarge = errors.New("the bundle is too large")

// ErrArchive: an upload is no archive that we can read. It counts as job.ErrInvalid.
var ErrArchive = fmt.Errorf("%w: unreadable archive", job.ErrInvalid)

// EntryError says which entry of an archive is at fault, and why. It wraps job.ErrInvalid.
type EntryError struct {
	Entry  string
	Detail string
}

func (e *EntryError) Error() string { return fmt.Sprintf("entry %q: %s", e.Entry, e.Detail) }

// Unwrap makes errors.Is(err, job.ErrInvalid) true.
func (e *EntryError) Unwrap() error { return job.ErrInvalid }

// Limits bound what one upload may take.
type Limits struct {
	// UploadBytes of the archive itself.
	UploadBytes int64
	// UnpackedBytes of all files together.
	UnpackedBytes int64
	// Files in the bundle.
	Files int
}

// DefaultLimits hold the largest scenes in common use with room to spare.
func DefaultLimits() Limits {
	return Limits{UploadBytes: 4 << 30, UnpackedBytes: 16 << 30, Files: 20_000}
}

// CheckUpload refuses a size that is known before the upload.
func (l Limits) CheckUpload(size int64) error {
	if size > l.UploadBytes {
		return l.uploadError()
	}
	return nil
}

func (l Limits) uploadError() error {
	return fmt.Errorf("%w: the archive has more than the %d bytes (%s) that this server takes", ErrTooLarge, l.UploadBytes,
		humanize.IBytes(uint64(l.UploadBytes)))
}

func (l Limits) unpackedError(what string) error {
	return fmt.Errorf("%w: %s unpacks to more than the %d bytes (%s) that this server takes for a scene", ErrTooLarge, what,
		l.UnpackedBytes, humanize.IBytes(uint64(l.UnpackedBytes)))
}

// names is how many bytes the names of files and folders may take.
func (l Limits) names() int64 { return namesStart + namesPerFile*int64(l.Files) }

func (l Limits) namesError(name string) error {
	return fmt.Errorf("%w: with entry %q, the names of its files and folders take more than the %s that this server keeps for "+
		"%d files", ErrTooLarge, name, humanize.IBytes(uint64(l.names())), l.Files)
}

// Blobs is where the files go.
type Blobs interface {
	PutFile(ctx context.Context, r io.Reader, limit int64) (sha string, size int64, err error)
	PutManifest(ctx context.Context, files []blob.File) (digest string, err error)
	Manifest(ctx context.Context, digest string) ([]blob.File, error)
	List(ctx context.Context, kind blob.Kind) iter.Seq2[blob.Info, error]
}

// Scene is a stored bundle.
type Scene struct {
	// Digest names the bundle.
	Digest string `json:"digest"`
	// Entries are the files that may be scene files, best first.
	Entries []string `json:"entries"`
	// Files in ascending order of path.
	Files []blob.File `json:"files"`
}

// Listed is what a list says of a stored bundle.
type Listed struct {
	Digest  string   `json:"digest"`
	Entries []string `json:"entries" doc:"The files that may be scene files, best first."`
	Files   int      `json:"files"`
	Bytes   int64    `json:"bytes" doc:"Of all files."`
	// Used is when the bundle was last stored or a job referred to it.
	Used time.Time `json:"used"`
}

// Library is the set of stored bundles. Its methods may be called from several goroutines. A
// failed addition may leave files without a bundle in the blob store, where the next attempt finds
// them again.
type Library struct {
	blobs   Blobs
	limits  Limits
	tempDir string
}

// NewLibrary makes a library; zip uploads are held in tempDir ("": the system's) while they are
// unpacked.
func NewLibrary(blobs Blobs, limits Limits, tempDir string) *Library {
	return &Library{blobs: blobs, limits: limits, tempDir: tempDir}
}

// Limits of one upload.
func (l *Library) Limits() Limits { return l.limits }

// Scene returns a stored bundle; job.ErrNotFound if there is none of that digest.
func (l *Library) Scene(ctx context.Context, digest string) (Scene, error) {
	files, err := l.blobs.Manifest(ctx, digest)
	switch {
	case errors.Is(err, blob.ErrNotFound), errors.Is(err, blob.ErrName):
		return Scene{}, fmt.Errorf("scene %q: %w", digest, job.ErrNotFound)
	case err != nil:
		return Scene{}, fmt.Errorf("scene %s: %w", digest, err)
	}
	return Scene{Digest: digest, Entries: Entries(files), Files: files}, nil
}

// maxListed bounds what a list reads: each bundle is a blob to open.
const maxListed = 100

// Scenes lists the bundles that have a scene file, the latest used first, at most 100.
func (l *Library) Scenes(ctx context.Context) ([]Listed, error) {
	var stored []blob.Info
	for info, err := range l.blobs.List(ctx, blob.Manifests) {
		if err != nil {
			return nil, fmt.Errorf("scenes: %w", err)
		}
		stored = append(stored, info)
	}
	slices.SortFunc(stored, func(a, b blob.Info) int {
		return cmp.Or(b.Modified.Compare(a.Modified), strings.Compare(a.Name, b.Name))
	})
	scenes := []Listed{}
	for _, info := range stored[:min(len(stored), maxListed)] {
		files, err := l.blobs.Manifest(ctx, info.Name)
		switch {
		case errors.Is(err, blob.ErrNotFound): // removed since
			continue
		case err != nil:
			return nil, fmt.Errorf("scenes: %w", err)
		}
		listed := Listed{Digest: info.Name, Entries: Entries(files), Files: len(files), Used: info.Modified}
		for _, file := range files {
			listed.Bytes += file.Size
		}
		if len(listed.Entries) > 0 {
			scenes = append(scenes, listed)
		}
	}
	return scenes, nil
}

var sceneExtensions = []string{".xml", ".pbrt"}

// IsScene tells by a file's name whether it is a scene of a format that workers read.
func IsScene(name string) bool {
	return slices.Contains(sceneExtensions, strings.ToLower(path.Ext(name)))
}

// Entries lists the files of a bundle that may be its scene file: those of a format that workers
// read, nearest to the root first.
func Entries(files []blob.File) []string {
	entries := []string{}
	deepest := 0
	for _, file := range files {
		deepest = max(deepest, depth(file.Path))
	}
	for level := range deepest + 1 {
		for _, file := range files {
			if depth(file.Path) == level && IsScene(file.Path) {
				entries = append(entries, file.Path)
			}
		}
	}
	return entries
}

func depth(name string) int { return strings.Count(name, "/") }

// collector takes the files of one bundle, entry by entry, and enforces the rules that hold for
// every kind of source.
type collector struct {
	blobs  Blobs
	limits Limits
	files  []blob.File
	bytes  int64
	names  map[string]bool // files
	dirs   map[string]bool // folders that files lie in
	room   int64           // bytes that names and dirs may still take
}

// What the names of a scene's files and of the folders around them may take in memory: a start, and so
// much for each file that is allowed, of which a name takes its length and nameOverhead.
const (
	namesStart   = 64 << 10
	namesPerFile = 512
	nameOverhead = 64
)

// maxFolders is how many folders a file may lie in, one in the other.
const maxFolders = 32

func newCollector(blobs Blobs, limits Limits) *collector {
	return &collector{
		blobs: blobs, limits: limits,
		names: make(map[string]bool), dirs: make(map[string]bool), room: limits.names(),
	}
}

func (c *collector) add(ctx context.Context, name string, r io.Reader) error {
	if err := c.reserve(name); err != nil {
		return err
	}
	sha, size, err := c.blobs.PutFile(ctx, r, c.limits.UnpackedBytes-c.bytes)
	if errors.Is(err, blob.ErrTooLarge) {
		return c.limits.unpackedError(fmt.Sprintf("with entry %q, it", name))
	}
	if err != nil {
		return fmt.Errorf("entry %q: %w", name, err)
	}
	c.bytes += size
	c.files = append(c.files, blob.File{Path: name, Size: size, SHA256: sha})
	return nil
}

// reserve checks a name against the rules and against the names before it.
func (c *collector) reserve(name string) error {
	if !blob.ValidPath(name) {
		return &EntryError{name, "the path must be relative, with '/' between its parts and without " +
			`empty, "." or ".." parts, backslashes or control characters, in at most 1024 bytes of UTF-8`}
	}
	if depth(name) > maxFolders {
		return &EntryError{name, fmt.Sprintf("lies in %d folders, one in the other; at most %d are allowed", depth(name), maxFolders)}
	}
	if len(c.files) >= c.limits.Files {
		return fmt.Errorf("%w: entry %q is one more than the %d files that this server takes for a scene", ErrTooLarge, name,
			c.limits.Files)
	}
	if c.names[name] {
		return &EntryError{name, "appears twice"}
	}
	if c.dirs[name] {
		return &EntryError{name, "is a file and a folder at once"}
	}
	// A folder that is known has passed with all that it lies in.
	for dir := path.Dir(name); dir != "." && !c.dirs[dir]; dir = path.Dir(dir) {
		if c.names[dir] {
			return &EntryError{dir, "is a file and a folder at once"}
		}
		if !c.keep(c.dirs, dir) {
			return c.limits.namesError(name)
		}
	}
	if !c.keep(c.names, name) {
		return c.limits.namesError(name)
	}
	return nil
}

// keep notes a name if there is room for it.
func (c *collector) keep(names map[string]bool, name string) bool {
	if c.room -= int64(len(name)) + nameOverhead; c.room < 0 {
		return false
	}
	names[name] = true
	return true
}

func (c *collector) finish(ctx context.Context) (Scene, error) {
	if len(c.files) == 0 {
		return Scene{}, fmt.Errorf("%w: there is no file in it", ErrArchive)
	}
	digest, err := c.blobs.PutManifest(ctx, c.files)
	if err != nil {
		return Scene{}, fmt.Errorf("storing the manifest: %w", err)
	}
	files, err := c.blobs.Manifest(ctx, digest)
	if err != nil {
		return Scene{}, fmt.Errorf("reading the manifest back: %w", err)
	}
	return Scene{Digest: digest, Entries: Entries(files), Files: files}, nil
}
