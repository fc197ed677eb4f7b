// Package blobtest is the conformance suite of blob.Backend, run through blob.Store: what callers
// rely on holds wherever the bytes lie.
package blobtest

import (
	"context"
	"errors"
	"io"
	"strings"
	"testing"

	"metrofarm/services/internal/blob"
)

// Place makes an empty place; each call of what it returns opens the place again, as another process
// would.
type Place func(t *testing.T) (open func() blob.Backend)

// Run runs the suite.
func Run(t *testing.T, place Place) {
	for name, test := range map[string]func(*testing.T, func() blob.Backend){
		"files are named by content":            testFiles,
		"damage is noticed and mended":          testDamage,
		"a limit leaves nothing behind":         testLimit,
		"a manifest's digest ignores order":     testManifest,
		"manifests that are refused":            testManifestRefusals,
		"use renews a manifest's time":          testUse,
		"named blobs are replaced whole":        testReplace,
		"a failed write keeps the old blob":     testFailedWrite,
		"a canceled write keeps the old blob":   testCanceledWrite,
		"names cannot escape":                   testNames,
		"what is missing is not found":          testMissing,
		"content outlives its opener":           testReopen,
		"one file by many writers":              testManyWriters,
		"one blob by many writers":              testManyVersions,
		"more than a thousand names are listed": testManyNames,
		"a big blob takes little memory":        testBigBlob,
		"a write under way is not unfinished":   testUnfinished,
	} {
		t.Run(name, func(t *testing.T) { test(t, place(t)) })
	}
}

func check(t *testing.T, err error) {
	t.Helper()
	if err != nil {
		t.Fatal(err)
	}
}

func put(t *testing.T, s *blob.Store, path, content string) blob.File {
	t.Helper()
	sha, size, err := s.PutFile(t.Context(), strings.NewReader(content), 1<<20)
	check(t, err)
	return blob.File{Path: path, Size: size, SHA256: sha}
}

func write(t *testing.T, s *blob.Store, name, content string) {
	t.Helper()
	check(t, s.WriteBlob(t.Context(), name, text(content)))
}

func text(content string) func(io.Writer) error {
	return func(w io.Writer) error {
		_, err := io.WriteString(w, content)
		return err
	}
}

func read(t *testing.T, r io.ReadCloser, err error) string {
	t.Helper()
	check(t, err)
	defer r.Close()
	content, err := io.ReadAll(r)
	check(t, err)
	return string(content)
}

func expectBlob(t *testing.T, s *blob.Store, name, want string) {
	t.Helper()
	r, err := s.OpenBlob(t.Context(), name)
	if got := read(t, r, err); got != want {
		t.Errorf("blob %s is %.40q, want %.40q", name, got, want)
	}
}

func names(t *testing.T, s *blob.Store, kind blob.Kind) map[string]blob.Info {
	t.Helper()
	found := make(map[string]blob.Info)
	for info, err := range s.List(t.Context(), kind) {
		check(t, err)
		if _, twice := found[info.Name]; twice {
			t.Errorf("%s is listed twice", info.Name)
		}
		found[info.Name] = info
	}
	return found
}

func testFiles(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	f := put(t, s, "a", "hello")
	const want = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"
	if f.SHA256 != want || f.Size != 5 {
		t.Fatalf("got %+v", f)
	}
	r, err := s.OpenFile(t.Context(), f.SHA256)
	if got := read(t, r, err); got != "hello" {
		t.Errorf("read %q", got)
	}
	empty := put(t, s, "b", "")
	r, err = s.OpenFile(t.Context(), empty.SHA256)
	if got := read(t, r, err); got != "" {
		t.Errorf("read %q", got)
	}
	if listed := names(t, s, blob.Files); len(listed) != 2 || listed[want].Size != 5 {
		t.Errorf("listed %+v", listed)
	}
}

func testDamage(t *testing.T, open func() blob.Backend) {
	backend := open()
	s := blob.New(backend)
	f := put(t, s, "a", "hello")
	check(t, backend.Write(t.Context(), blob.Key{Kind: blob.Files, Name: f.SHA256}, text("jello")))
	r, err := s.OpenFile(t.Context(), f.SHA256)
	check(t, err)
	if _, err := io.ReadAll(r); !errors.Is(err, blob.ErrCorrupt) {
		t.Errorf("a damaged file: %v", err)
	}
	check(t, r.Close())
	put(t, s, "a", "hello")
	r, err = s.OpenFile(t.Context(), f.SHA256)
	if got := read(t, r, err); got != "hello" {
		t.Errorf("read %q", got)
	}
	digest, err := s.PutManifest(t.Context(), []blob.File{f})
	check(t, err)
	check(t, backend.Write(t.Context(), blob.Key{Kind: blob.Manifests, Name: digest}, text("[]")))
	if _, err := s.Manifest(t.Context(), digest); !errors.Is(err, blob.ErrCorrupt) {
		t.Errorf("a damaged manifest: %v", err)
	}
}

func testLimit(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	if _, _, err := s.PutFile(t.Context(), strings.NewReader("12345"), 4); !errors.Is(err, blob.ErrTooLarge) {
		t.Errorf("got %v, want ErrTooLarge", err)
	}
	if listed := names(t, s, blob.Files); len(listed) != 0 {
		t.Errorf("left %+v", listed)
	}
	if _, _, err := s.PutFile(t.Context(), strings.NewReader("1234"), 4); err != nil {
		t.Errorf("exactly the limit: %v", err)
	}
}

func testReplace(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	for _, content := range []string{"first", "the second is longer", "", "4"} {
		write(t, s, "checkpoint-1", content)
		expectBlob(t, s, "checkpoint-1", content)
		info, err := s.Stat(t.Context(), blob.Named, "checkpoint-1")
		check(t, err)
		if info.Name != "checkpoint-1" || info.Size != int64(len(content)) || info.Modified.IsZero() {
			t.Errorf("described as %+v", info)
		}
	}
	check(t, s.Delete(t.Context(), blob.Named, "checkpoint-1"))
	if listed := names(t, s, blob.Named); len(listed) != 0 {
		t.Errorf("after Delete: %+v", listed)
	}
}

func testFailedWrite(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	write(t, s, "checkpoint-1", "old")
	boom := errors.New("boom")
	// A few bytes, and so many that some are on their way already.
	for _, size := range []int{3, 3 << 20} {
		err := s.WriteBlob(t.Context(), "checkpoint-1", func(w io.Writer) error {
			return errors.Join(text(strings.Repeat("n", size))(w), boom)
		})
		if !errors.Is(err, boom) {
			t.Errorf("%d bytes: %v", size, err)
		}
		expectBlob(t, s, "checkpoint-1", "old")
	}
}

func testCanceledWrite(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	write(t, s, "checkpoint-1", "old")
	ctx, cancel := context.WithCancel(t.Context())
	err := s.WriteBlob(ctx, "checkpoint-1", func(w io.Writer) error {
		err := text(strings.Repeat("n", 3<<20))(w)
		cancel()
		return err
	})
	if !errors.Is(err, context.Canceled) {
		t.Errorf("writing: %v", err)
	}
	expectBlob(t, s, "checkpoint-1", "old")
	if _, _, err := s.PutFile(ctx, strings.NewReader("x"), 10); !errors.Is(err, context.Canceled) {
		t.Errorf("PutFile: %v", err)
	}
	if _, err := s.OpenBlob(ctx, "checkpoint-1"); !errors.Is(err, context.Canceled) {
		t.Errorf("OpenBlob: %v", err)
	}
}

func testReopen(t *testing.T, open func() blob.Backend) {
	first := blob.New(open())
	f := put(t, first, "scene.xml", "<scene/>")
	digest, err := first.PutManifest(t.Context(), []blob.File{f})
	check(t, err)
	write(t, first, "checkpoint-1", "film")
	second := blob.New(open())
	expectBlob(t, second, "checkpoint-1", "film")
	files, err := second.Manifest(t.Context(), digest)
	check(t, err)
	if len(files) != 1 || files[0] != f {
		t.Errorf("manifest %+v", files)
	}
	r, err := second.OpenFile(t.Context(), f.SHA256)
	if got := read(t, r, err); got != "<scene/>" {
		t.Errorf("read %q", got)
	}
}
