package bundle

import (
	"archive/tar"
	"archive/zip"
	"bufio"
	"bytes"
	"compress/gzip"
	"context"
	"errors"
	"fmt"
	"io"
	"io/fs"
	"math"
	"os"
	"strings"

	"github.com/klauspost/compress/zstd"
)

// AddArchive unpacks an archive (zip, or tar plain, gzipped or with zstd; told by content) into the
// blob store.
func (l *Library) AddArchive(ctx context.Context, r io.Reader) (Scene, error) {
	c := newCollector(l.blobs, l.limits)
	limited := &limitedReader{r: r, left: l.limits.UploadBytes}
	if err := l.unpack(ctx, c, bufio.NewReader(limited)); err != nil {
		if limited.exceeded {
			return Scene{}, l.limits.uploadError()
		}
		return Scene{}, err
	}
	return c.finish(ctx)
}

// tarHeaderSize is also how far into a tar file its magic number is found.
const tarHeaderSize = 512

func (l *Library) unpack(ctx context.Context, c *collector, r *bufio.Reader) error {
	start, err := r.Peek(tarHeaderSize)
	if err != nil && !errors.Is(err, io.EOF) {
		return fmt.Errorf("reading the upload: %w", err)
	}
	switch {
	case len(start) == 0:
		return fmt.Errorf("%w: it is empty", ErrArchive)
	case bytes.HasPrefix(start, []byte("PK\x03\x04")), bytes.HasPrefix(start, []byte("PK\x05\x06")):
		return l.unpackZip(ctx, c, r)
	case bytes.HasPrefix(start, []byte("\x1f\x8b")):
		return unpackGzip(ctx, c, r)
	case bytes.HasPrefix(start, []byte("\x28\xb5\x2f\xfd")):
		return unpackZstd(ctx, c, r)
	case len(start) == tarHeaderSize && string(start[257:262]) == "ustar":
		return unpackTar(ctx, c, r)
	default:
		return fmt.Errorf("%w: it is neither zip nor tar (plain, gzip or zstd)", ErrArchive)
	}
}

func unpackGzip(ctx context.Context, c *collector, r io.Reader) error {
	unzipped, err := gzip.NewReader(r)
	if err != nil {
		return fmt.Errorf("%w: %w", ErrArchive, err)
	}
	defer unzipped.Close()
	return unpackTar(ctx, c, unzipped)
}

// zstdMemory bounds the window that a frame may ask for.
const zstdMemory = 128 << 20

func unpackZstd(ctx context.Context, c *collector, r io.Reader) error {
	decoder, err := zstd.NewReader(r, zstd.WithDecoderConcurrency(1),
		zstd.WithDecoderMaxWindow(zstdMemory))
	if err != nil {
		return fmt.Errorf("%w: %w", ErrArchive, err)
	}
	defer decoder.Close()
	return unpackTar(ctx, c, decoder)
}

// tarOverhead is how much of headers and padding an unpacked tar stream may hold beside its
// files, per file allowed: without a bound, a compressed stream of headers alone could run forever.
const tarOverhead = 16 << 10

func unpackTar(ctx context.Context, c *collector, r io.Reader) error {
	stream := &limitedReader{
		r: r, left: c.limits.UnpackedBytes + tarOverhead*int64(c.limits.Files+1),
	}
	archive := tar.NewReader(stream)
	for {
		header, err := archive.Next()
		switch {
		case errors.Is(err, io.EOF):
			return nil
		case stream.exceeded:
			return c.limits.unpackedError("the archive")
		case err != nil:
			return fmt.Errorf("%w: %w", ErrArchive, err)
		}
		if err := addTarEntry(ctx, c, header, archive); err != nil {
			return err
		}
	}
}

func addTarEntry(ctx context.Context, c *collector, header *tar.Header, r io.Reader) error {
	switch header.Typeflag {
	case tar.TypeDir, tar.TypeXGlobalHeader:
		return nil
	case tar.TypeReg:
		return c.add(ctx, withoutDot(header.Name), corruptReader{r})
	case tar.TypeSymlink, tar.TypeLink:
		return &EntryError{header.Name, "links are not allowed; put the file itself into the archive"}
	default:
		return &EntryError{header.Name, "only regular files and folders are allowed"}
	}
}

// A zip's directory is read into memory as a whole, before any file can be counted. So much of it is
// read: the search for its beginning, and entries with long names.
const (
	zipDirectoryStart = 256 << 10
	zipDirectoryEntry = 512
)

// unpackZip needs the whole archive first: its directory is at the end.
func (l *Library) unpackZip(ctx context.Context, c *collector, r io.Reader) error {
	spool, err := os.CreateTemp(l.tempDir, "metrofarm-upload-*")
	if err != nil {
		return fmt.Errorf("holding the upload: %w", err)
	}
	defer os.Remove(spool.Name())
	defer spool.Close()
	size, err := io.Copy(spool, r)
	if err != nil {
		return fmt.Errorf("holding the upload: %w", err)
	}
	directory := &budgetReader{r: spool, left: zipDirectoryStart + zipDirectoryEntry*int64(l.limits.Files)}
	archive, err := zip.NewReader(directory, size)
	if directory.exceeded {
		return fmt.Errorf("%w: its directory is larger than %d files need, which is what this server takes", ErrTooLarge, l.limits.Files)
	}
	directory.left = math.MaxInt64
	if err != nil {
		return fmt.Errorf("%w: %w", ErrArchive, err)
	}
	for _, file := range archive.File {
		if err := addZipEntry(ctx, c, file); err != nil {
			return err
		}
	}
	return nil
}

const zipEncrypted = 1 // bit of zip.FileHeader.Flags

func addZipEntry(ctx context.Context, c *collector, file *zip.File) error {
	mode := file.Mode()
	switch {
	case mode.IsDir():
		return nil
	case mode&fs.ModeSymlink != 0:
		return &EntryError{file.Name, "links are not allowed; put the file itself into the archive"}
	case !mode.IsRegular():
		return &EntryError{file.Name, "only regular files and folders are allowed"}
	case file.Flags&zipEncrypted != 0:
		return &EntryError{file.Name, "is encrypted"}
	}
	r, err := file.Open()
	if err != nil {
		return &EntryError{file.Name, err.Error()}
	}
	defer r.Close()
	return c.add(ctx, withoutDot(file.Name), corruptReader{r})
}

// withoutDot removes the "./" that tar writes when it packs the current folder.
func withoutDot(name string) string { return strings.TrimPrefix(name, "./") }

// corruptReader marks errors of decompression as the archive's fault.
type corruptReader struct{ r io.Reader }

func (c corruptReader) Read(p []byte) (int, error) {
	n, err := c.r.Read(p)
	if err != nil && !errors.Is(err, io.EOF) {
		err = fmt.Errorf("%w: %w", ErrArchive, err)
	}
	return n, err
}

// budgetReader fails when more is read than allowed, wherever.
type budgetReader struct {
	r        io.ReaderAt
	left     int64
	exceeded bool
}

func (b *budgetReader) ReadAt(p []byte, offset int64) (int, error) {
	if b.left -= int64(len(p)); b.left < 0 {
		b.exceeded = true
		return 0, errLimit
	}
	return b.r.ReadAt(p, offset)
}

var errLimit = errors.New("limit reached")

// limitedReader fails, other than io.LimitReader, when there is more than allowed.
type limitedReader struct {
	r        io.Reader
	left     int64
	exceeded bool
}

func (l *limitedReader) Read(p []byte) (int, error) {
	// One byte more than allowed may be asked for: it tells the end from an excess.
	if int64(len(p)) > l.left+1 {
		p = p[:l.left+1]
	}
	n, err := l.r.Read(p)
	if l.left -= int64(n); l.left < 0 {
		l.exceeded = true
		return 0, errLimit
	}
	return n, err
}
