package blob

import (
	"context"
	"errors"
	"io"
	"os"
	"path/filepath"
	"strings"
	"testing"
)

func openTemp(t *testing.T) *Store {
	t.Helper()
	s, err := Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	return s
}

func put(t *testing.T, s *Store, path, content string) File {
	t.Helper()
	sha, size, err := s.PutFile(context.Background(), strings.NewReader(content), 1<<20)
	if err != nil {
		t.Fatal(err)
	}
	return File{Path: path, Size: size, SHA256: sha}
}

func TestFilesAreNamedByContent(t *testing.T) {
	s := openTemp(t)
	f := put(t, s, "a", "hello")
	const want = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"
	if f.SHA256 != want || f.Size != 5 {
		t.Fatalf("got %+v", f)
	}
	r, err := s.OpenFile(f.SHA256)
	if err != nil {
		t.Fatal(err)
	}
	defer r.Close()
	if got, _ := io.ReadAll(r); string(got) != "hello" {
		t.Fatalf("read %q", got)
	}
}

func TestLimitLeavesNothingBehind(t *testing.T) {
	s := openTemp(t)
	if _, _, err := s.PutFile(context.Background(), strings.NewReader("12345"), 4); !errors.Is(err, ErrTooLarge) {
		t.Fatalf("got %v, want ErrTooLarge", err)
	}
	for _, dir := range []string{filesDir, temporaryDir} {
		if entries, _ := os.ReadDir(s.path(dir)); len(entries) != 0 {
			t.Errorf("%s holds %d entries", dir, len(entries))
		}
	}
}

func TestManifestDigestIgnoresOrder(t *testing.T) {
	s := openTemp(t)
	a, b := put(t, s, "a.xml", "A"), put(t, s, "meshes/b.ply", "B")
	first, err := s.PutManifest(context.Background(), []File{a, b})
	if err != nil {
		t.Fatal(err)
	}
	second, err := s.PutManifest(context.Background(), []File{b, a})
	if err != nil || first != second {
		t.Fatalf("digests %s and %s, error %v", first, second, err)
	}
	files, err := s.Manifest(first)
	if err != nil || len(files) != 2 || files[0] != a || files[1] != b {
		t.Fatalf("manifest %+v, error %v", files, err)
	}
}

func TestManifestRefusals(t *testing.T) {
	s := openTemp(t)
	good := put(t, s, "a", "A")
	missing := File{Path: "b", Size: 1, SHA256: strings.Repeat("0", 64)}
	wrongSize := good
	wrongSize.Size++
	escape := good
	escape.Path = "../a"
	for name, files := range map[string][]File{
		"empty": nil, "missing": {missing}, "size": {wrongSize}, "escape": {escape}, "twice": {good, good},
	} {
		if _, err := s.PutManifest(context.Background(), files); err == nil {
			t.Errorf("%s: accepted", name)
		}
	}
}

func TestValidPath(t *testing.T) {
	for path, want := range map[string]bool{
		"a": true, "a/b.xml": true, "": false, "/a": false, "a/": false, "a//b": false, "./a": false,
		"a/../b": false, "a\nb": false, "a\\b": false, strings.Repeat("x", 1025): false, "\xff": false,
	} {
		if got := ValidPath(path); got != want {
			t.Errorf("ValidPath(%q) = %v", path, got)
		}
	}
}

func TestFailedWriteKeepsOldBlob(t *testing.T) {
	s := openTemp(t)
	write := func(content string, fail error) error {
		return s.WriteBlob("checkpoint-1", func(w io.Writer) error {
			if _, err := io.WriteString(w, content); err != nil {
				return err
			}
			return fail
		})
	}
	if err := write("old", nil); err != nil {
		t.Fatal(err)
	}
	boom := errors.New("boom")
	if err := write("new", boom); !errors.Is(err, boom) {
		t.Fatalf("got %v", err)
	}
	r, err := s.OpenBlob("checkpoint-1")
	if err != nil {
		t.Fatal(err)
	}
	defer r.Close()
	if got, _ := io.ReadAll(r); string(got) != "old" {
		t.Fatalf("read %q", got)
	}
}

func TestNamesCannotEscape(t *testing.T) {
	s := openTemp(t)
	if err := os.WriteFile(filepath.Join(s.dir, "secret"), nil, 0o600); err != nil {
		t.Fatal(err)
	}
	for _, name := range []string{"../secret", "", ".hidden", "a/b"} {
		if _, err := s.OpenBlob(name); !errors.Is(err, ErrName) {
			t.Errorf("OpenBlob(%q) = %v", name, err)
		}
		if err := s.DeleteBlob(name); !errors.Is(err, ErrName) {
			t.Errorf("DeleteBlob(%q) = %v", name, err)
		}
	}
	if _, err := s.OpenFile("../secret"); !errors.Is(err, ErrName) {
		t.Errorf("OpenFile: %v", err)
	}
}

func TestOpenClearsInterruptedWrites(t *testing.T) {
	dir := t.TempDir()
	if _, err := Open(dir); err != nil {
		t.Fatal(err)
	}
	left := filepath.Join(dir, temporaryDir, "write-1")
	if err := os.WriteFile(left, []byte("half"), 0o600); err != nil {
		t.Fatal(err)
	}
	if _, err := Open(dir); err != nil {
		t.Fatal(err)
	}
	if _, err := os.Stat(left); !errors.Is(err, os.ErrNotExist) {
		t.Fatalf("left over: %v", err)
	}
}
