package blobtest

import (
	"errors"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
)

func testManifest(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	a, b := put(t, s, "a.xml", "A"), put(t, s, "meshes/b.ply", "B")
	first, err := s.PutManifest(t.Context(), []blob.File{a, b})
	check(t, err)
	second, err := s.PutManifest(t.Context(), []blob.File{b, a})
	check(t, err)
	if first != second {
		t.Fatalf("digests %s and %s", first, second)
	}
	files, err := s.Manifest(t.Context(), first)
	check(t, err)
	if len(files) != 2 || files[0] != a || files[1] != b {
		t.Errorf("manifest %+v", files)
	}
	if listed := names(t, s, blob.Manifests); len(listed) != 1 || listed[first].Name != first {
		t.Errorf("listed %+v", listed)
	}
}

func testManifestRefusals(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	good := put(t, s, "a", "A")
	missing := blob.File{Path: "b", Size: 1, SHA256: strings.Repeat("0", 64)}
	wrongSize, escape, noDigest := good, good, good
	wrongSize.Size++
	escape.Path = "../a"
	noDigest.SHA256 = "../a"
	for name, c := range map[string]struct {
		files []blob.File
		want  error
	}{
		"empty": {nil, blob.ErrName}, "missing": {[]blob.File{missing}, blob.ErrNotFound},
		"size": {[]blob.File{wrongSize}, blob.ErrName}, "escape": {[]blob.File{escape}, blob.ErrName},
		"twice": {[]blob.File{good, good}, blob.ErrName}, "digest": {[]blob.File{noDigest}, blob.ErrName},
	} {
		if _, err := s.PutManifest(t.Context(), c.files); !errors.Is(err, c.want) {
			t.Errorf("%s: %v, want %v", name, err, c.want)
		}
	}
	if listed := names(t, s, blob.Manifests); len(listed) != 0 {
		t.Errorf("stored %+v", listed)
	}
}

func testUse(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	f := put(t, s, "a", "A")
	digest, err := s.PutManifest(t.Context(), []blob.File{f})
	check(t, err)
	before, err := s.Stat(t.Context(), blob.Manifests, digest)
	check(t, err)
	time.Sleep(1100 * time.Millisecond) // buckets count in seconds
	files, err := s.UseManifest(t.Context(), digest)
	check(t, err)
	if len(files) != 1 || files[0] != f {
		t.Errorf("manifest %+v", files)
	}
	after, err := s.Stat(t.Context(), blob.Manifests, digest)
	check(t, err)
	if !after.Modified.After(before.Modified) || after.Size != before.Size {
		t.Errorf("%+v, then %+v", before, after)
	}
}

func testNames(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	for _, name := range []string{"../files", "", ".hidden", "a/b", "a\\b", strings.Repeat("x", 129)} {
		if err := s.WriteBlob(t.Context(), name, text("x")); !errors.Is(err, blob.ErrName) {
			t.Errorf("WriteBlob(%q): %v", name, err)
		}
		if _, err := s.OpenBlob(t.Context(), name); !errors.Is(err, blob.ErrName) {
			t.Errorf("OpenBlob(%q): %v", name, err)
		}
		for _, kind := range blob.Kinds() {
			if err := s.Delete(t.Context(), kind, name); !errors.Is(err, blob.ErrName) {
				t.Errorf("Delete(%s, %q): %v", kind, name, err)
			}
			if _, err := s.Stat(t.Context(), kind, name); !errors.Is(err, blob.ErrName) {
				t.Errorf("Stat(%s, %q): %v", kind, name, err)
			}
		}
		if _, err := s.OpenFile(t.Context(), name); !errors.Is(err, blob.ErrName) {
			t.Errorf("OpenFile(%q): %v", name, err)
		}
		if _, err := s.Manifest(t.Context(), name); !errors.Is(err, blob.ErrName) {
			t.Errorf("Manifest(%q): %v", name, err)
		}
	}
}

func testMissing(t *testing.T, open func() blob.Backend) {
	s := blob.New(open())
	digest := strings.Repeat("0", 64)
	if _, err := s.OpenBlob(t.Context(), "none"); !errors.Is(err, blob.ErrNotFound) {
		t.Errorf("OpenBlob: %v", err)
	}
	if _, err := s.OpenFile(t.Context(), digest); !errors.Is(err, blob.ErrNotFound) {
		t.Errorf("OpenFile: %v", err)
	}
	if _, err := s.Manifest(t.Context(), digest); !errors.Is(err, blob.ErrNotFound) {
		t.Errorf("Manifest: %v", err)
	}
	if _, err := s.UseManifest(t.Context(), digest); !errors.Is(err, blob.ErrNotFound) {
		t.Errorf("UseManifest: %v", err)
	}
	for _, kind := range blob.Kinds() {
		if _, err := s.Stat(t.Context(), kind, digest); !errors.Is(err, blob.ErrNotFound) {
			t.Errorf("Stat(%s): %v", kind, err)
		}
		if err := s.Delete(t.Context(), kind, digest); err != nil {
			t.Errorf("Delete(%s): %v", kind, err)
		}
		if listed := names(t, s, kind); len(listed) != 0 {
			t.Errorf("listed %+v", listed)
		}
	}
}
