package bundle_test

import (
	"archive/tar"
	"archive/zip"
	"bytes"
	"compress/gzip"
	"errors"
	"fmt"
	"io"
	"io/fs"
	"os"
	"path/filepath"
	"slices"
	"strings"
	"testing"

	"github.com/klauspost/compress/zstd"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/job"
)

type entry struct {
	name, content string
	mode          fs.FileMode
}

func zipped(t testing.TB, entries ...entry) []byte {
	t.Helper()
	var buffer bytes.Buffer
	w := zip.NewWriter(&buffer)
	for _, e := range entries {
		header := &zip.FileHeader{Name: e.name, Method: zip.Deflate}
		header.SetMode(e.mode | 0o644)
		f, err := w.CreateHeader(header)
		if err == nil {
			_, err = io.WriteString(f, e.content)
		}
		if err != nil {
			t.Fatal(err)
		}
	}
	if err := w.Close(); err != nil {
		t.Fatal(err)
	}
	return buffer.Bytes()
}

func tarred(t testing.TB, headers ...tar.Header) []byte {
	t.Helper()
	var buffer bytes.Buffer
	w := tar.NewWriter(&buffer)
	for _, header := range headers {
		content := "content of " + header.Name
		if header.Typeflag == tar.TypeReg {
			header.Size = int64(len(content))
		}
		if err := w.WriteHeader(&header); err != nil {
			t.Fatal(err)
		}
		if header.Typeflag == tar.TypeReg {
			if _, err := io.WriteString(w, content); err != nil {
				t.Fatal(err)
			}
		}
	}
	if err := w.Close(); err != nil {
		t.Fatal(err)
	}
	return buffer.Bytes()
}

func reg(name string) tar.Header { return tar.Header{Typeflag: tar.TypeReg, Name: name, Mode: 0o644} }

func library(t testing.TB, limits bundle.Limits) *bundle.Library {
	t.Helper()
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	return bundle.NewLibrary(blob.New(backend), limits, t.TempDir())
}

func small() bundle.Limits {
	return bundle.Limits{UploadBytes: 1 << 20, UnpackedBytes: 4 << 20, Files: 10}
}

func TestDigestDoesNotDependOnTheArchive(t *testing.T) {
	l := library(t, small())
	plain := tarred(t, reg("scene.xml"), reg("meshes/a.ply"))
	dotted := tarredContent(t, entry{"./scene.xml", "content of scene.xml", 0},
		entry{"./meshes/a.ply", "content of meshes/a.ply", 0})
	archives := map[string][]byte{
		"tar": plain, "tar in another way": dotted, "gzip": gzipped(t, plain), "zstd": zstdCompressed(t, plain),
		"zip": zipped(t, entry{"meshes/", "", fs.ModeDir}, entry{"meshes/a.ply", "content of meshes/a.ply", 0},
			entry{"scene.xml", "content of scene.xml", 0}),
	}
	var digest string
	for name, archive := range archives {
		scene, err := l.AddArchive(t.Context(), bytes.NewReader(archive))
		if err != nil {
			t.Fatalf("%s: %v", name, err)
		}
		if digest == "" {
			digest = scene.Digest
		}
		if scene.Digest != digest || len(scene.Files) != 2 || !slices.Equal(scene.Entries, []string{"scene.xml"}) {
			t.Errorf("%s: %+v, want digest %s", name, scene, digest)
		}
	}
	again, err := l.Scene(t.Context(), digest)
	if err != nil || again.Digest != digest || len(again.Files) != 2 {
		t.Errorf("stored scene %+v, error %v", again, err)
	}
}

func tarredContent(t testing.TB, entries ...entry) []byte {
	t.Helper()
	var buffer bytes.Buffer
	w := tar.NewWriter(&buffer)
	for _, e := range entries {
		header := reg(e.name)
		header.Size = int64(len(e.content))
		if err := w.WriteHeader(&header); err != nil {
			t.Fatal(err)
		}
		if _, err := io.WriteString(w, e.content); err != nil {
			t.Fatal(err)
		}
	}
	if err := w.Close(); err != nil {
		t.Fatal(err)
	}
	return buffer.Bytes()
}

func gzipped(t testing.TB, data []byte) []byte {
	t.Helper()
	var buffer bytes.Buffer
	w := gzip.NewWriter(&buffer)
	if _, err := w.Write(data); err != nil {
		t.Fatal(err)
	}
	if err := w.Close(); err != nil {
		t.Fatal(err)
	}
	return buffer.Bytes()
}

func zstdCompressed(t testing.TB, data []byte) []byte {
	t.Helper()
	w, err := zstd.NewWriter(nil)
	if err != nil {
		t.Fatal(err)
	}
	return w.EncodeAll(data, nil)
}

func TestRefusals(t *testing.T) {
	link := func(kind byte) tar.Header {
		return tar.Header{Typeflag: kind, Name: "link", Linkname: "/etc/passwd"}
	}
	bomb := zipped(t, entry{"bomb", strings.Repeat("\x00", 5<<20), 0})
	good := zipped(t, entry{"scene.xml", strings.Repeat("<scene/>", 1000), 0})
	many := make([]tar.Header, 11)
	for i := range many {
		many[i] = reg(strings.Repeat("x", i+1))
	}
	few, crowd := make([]entry, 11), make([]entry, 5000)
	for i := range crowd {
		crowd[i].name = fmt.Sprintf("%032d", i)
		few[i%len(few)].name = fmt.Sprintf("%d", i%len(few))
	}
	// Folders are no files, but their headers take room.
	folders := make([]tar.Header, 10_000)
	for i := range folders {
		folders[i] = tar.Header{Typeflag: tar.TypeDir, Name: fmt.Sprintf("%d/", i), Mode: 0o755}
	}
	headers := tarred(t, folders...)
	cases := []struct {
		name    string
		archive []byte
		kind    error
		want    string // part of the message: it must name the entry
	}{
		{"parent in zip", zipped(t, entry{"../evil", "x", 0}), job.ErrInvalid, `"../evil"`},
		{"parent inside", zipped(t, entry{"a/../../evil", "x", 0}), job.ErrInvalid, `"a/../../evil"`},
		{"parent behind dot", zipped(t, entry{"./../evil", "x", 0}), job.ErrInvalid, `"../evil"`},
		{"absolute", zipped(t, entry{"/etc/passwd", "x", 0}), job.ErrInvalid, `"/etc/passwd"`},
		{"backslashes", zipped(t, entry{`..\evil`, "x", 0}), job.ErrInvalid, `..\\evil`},
		{"drive", zipped(t, entry{`C:\evil`, "x", 0}), job.ErrInvalid, `evil`},
		{"zip link", zipped(t, entry{"link", "/etc/passwd", fs.ModeSymlink}), job.ErrInvalid, `"link": links`},
		{"zip device", zipped(t, entry{"dev", "", fs.ModeDevice}), job.ErrInvalid, `"dev": only regular`},
		{"twice", zipped(t, entry{"a", "1", 0}, entry{"a", "2", 0}), job.ErrInvalid, `"a": appears twice`},
		{"twice by dot", zipped(t, entry{"a", "1", 0}, entry{"./a", "2", 0}), job.ErrInvalid, `"a": appears twice`},
		{"file below file", zipped(t, entry{"a", "1", 0}, entry{"a/b", "2", 0}), job.ErrInvalid, `"a": is a file and`},
		{"file above file", zipped(t, entry{"a/b", "1", 0}, entry{"a", "2", 0}), job.ErrInvalid, `"a": is a file and`},
		{"bomb", bomb, bundle.ErrTooLarge, `"bomb"`},
		{"tar bomb", gzipped(t, tarredContent(t, entry{"bomb", strings.Repeat("\x00", 5<<20), 0})), bundle.ErrTooLarge, `"bomb"`},
		{"too many", tarred(t, many...), bundle.ErrTooLarge, "10 files"},
		{"tar parent", tarred(t, reg("../evil")), job.ErrInvalid, `"../evil"`},
		{"tar symlink", tarred(t, link(tar.TypeSymlink)), job.ErrInvalid, `"link": links`},
		{"tar hard link", tarred(t, link(tar.TypeLink)), job.ErrInvalid, `"link": links`},
		{"tar fifo", tarred(t, link(tar.TypeFifo)), job.ErrInvalid, `"link": only regular`},
		{"empty upload", nil, job.ErrInvalid, "empty"},
		{"empty zip", zipped(t), job.ErrInvalid, "no file"},
		{"not an archive", []byte("<scene/>"), job.ErrInvalid, "neither zip nor tar"},
		{"zip cut short", good[:len(good)-30], job.ErrInvalid, "unreadable archive"},
		{"gzip cut short", gzipped(t, tarred(t, reg("a")))[:40], job.ErrInvalid, "unreadable archive"},
		{"too many in zip", zipped(t, few...), bundle.ErrTooLarge, "10 files"},
		{"far too many in zip", zipped(t, crowd...), bundle.ErrTooLarge, "larger than 10 files need"},
		{"unpacks to too much in all", zipped(t, entry{"a", strings.Repeat("\x00", 3<<20), 0}, entry{"b", strings.Repeat("\x00", 2<<20), 0}), bundle.ErrTooLarge, `with entry "b"`},
		{"headers of a bomb", gzipped(t, headers), bundle.ErrTooLarge, "4194304 bytes (4.0 MiB)"},
		{"deep", zipped(t, entry{strings.Repeat("d/", 33) + "a", "1", 0}), job.ErrInvalid, "33 folders, one in the other; at most 32"},
		{"upload too large", bytes.Repeat([]byte("PK\x03\x04"), 1<<19), bundle.ErrTooLarge, "1048576 bytes"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			_, err := library(t, small()).AddArchive(t.Context(), bytes.NewReader(c.archive))
			if !errors.Is(err, c.kind) || !strings.Contains(err.Error(), c.want) {
				t.Errorf("error %v, want %v with %s", err, c.kind, c.want)
			}
		})
	}
}

// TestNamesOfFoldersAreBounded: each file lies in folders of its own, as deep as is allowed.
func TestNamesOfFoldersAreBounded(t *testing.T) {
	limits := small()
	limits.Files = 50
	files := make([]entry, limits.Files)
	for i := range files {
		files[i] = entry{fmt.Sprintf("%d/%sfile", i, strings.Repeat("d/", 31)), "x", 0}
	}
	_, err := library(t, limits).AddArchive(t.Context(), bytes.NewReader(zipped(t, files...)))
	if !errors.Is(err, bundle.ErrTooLarge) || !strings.Contains(err.Error(), "names of its files and folders take more than the 89 KiB") {
		t.Errorf("folders for each file: %v", err)
	}
	for i := range files {
		files[i].name = fmt.Sprintf("%s%d/%s", strings.Repeat("d/", 31), i%10, strings.Repeat("f", 100)+fmt.Sprint(i))
	}
	if _, err := library(t, limits).AddArchive(t.Context(), bytes.NewReader(zipped(t, files...))); err != nil {
		t.Errorf("shared folders: %v", err)
	}
}

func TestCorruptContentIsTheArchivesFault(t *testing.T) {
	archive := zipped(t, entry{"scene.xml", strings.Repeat("<scene/>", 1000), 0})
	archive[50] ^= 0xff
	_, err := library(t, small()).AddArchive(t.Context(), bytes.NewReader(archive))
	if !errors.Is(err, bundle.ErrArchive) || !strings.Contains(err.Error(), `"scene.xml"`) {
		t.Errorf("error %v, want ErrArchive naming the entry", err)
	}
}

func TestUnknownScene(t *testing.T) {
	for _, digest := range []string{"", "../x", strings.Repeat("0", 64)} {
		if _, err := library(t, small()).Scene(t.Context(), digest); !errors.Is(err, job.ErrNotFound) {
			t.Errorf("%q: %v, want ErrNotFound", digest, err)
		}
	}
}

func TestEntriesNearestToTheRootFirst(t *testing.T) {
	got := bundle.Entries([]blob.File{
		{Path: "a/b/c.xml"}, {Path: "a/b.xml"}, {Path: "mesh.ply"}, {Path: "z.XML"},
	})
	if want := []string{"z.XML", "a/b.xml", "a/b/c.xml"}; !slices.Equal(got, want) {
		t.Errorf("%v, want %v", got, want)
	}
}

func TestLocalFilesAndTheirTarAreOneBundle(t *testing.T) {
	dir := t.TempDir()
	scene, mesh := filepath.Join(dir, "scenes", "box", "scene.xml"), filepath.Join(dir, "scenes", "meshes", "a.ply")
	for _, file := range []string{scene, mesh} {
		if err := os.MkdirAll(filepath.Dir(file), 0o750); err != nil {
			t.Fatal(err)
		}
		if err := os.WriteFile(file, []byte(file), 0o600); err != nil {
			t.Fatal(err)
		}
	}
	local, err := bundle.NewLocal(scene, []string{mesh, scene})
	if err != nil {
		t.Fatal(err)
	}
	if local.Root != filepath.Join(dir, "scenes") || local.Entry != "box/scene.xml" ||
		!slices.Equal(local.Paths, []string{"box/scene.xml", "meshes/a.ply"}) {
		t.Fatalf("local %+v", local)
	}
	l := library(t, small())
	direct, err := l.AddLocal(t.Context(), local)
	if err != nil {
		t.Fatal(err)
	}
	var archive bytes.Buffer
	if err := local.WriteTar(&archive); err != nil {
		t.Fatal(err)
	}
	uploaded, err := l.AddArchive(t.Context(), &archive)
	if err != nil || uploaded.Digest != direct.Digest {
		t.Errorf("uploaded %+v, error %v; want digest %s", uploaded, err, direct.Digest)
	}
}

func TestFoldersWidenTheRootAndAreNotTaken(t *testing.T) {
	scene := filepath.Join("/", "s", "tests", "spot", "scene.xml")
	image := filepath.Join("/", "s", "tests", "spot", "textures", "a.png")
	common := filepath.Join("/", "s", "common") + string(filepath.Separator)
	local, err := bundle.NewLocal(scene, []string{common, scene, image})
	want := []string{"tests/spot/scene.xml", "tests/spot/textures/a.png"}
	if err != nil || local.Root != filepath.Join("/", "s") || local.Entry != want[0] || !slices.Equal(local.Paths, want) {
		t.Errorf("local %+v, error %v", local, err)
	}
}

func TestNewLocalWantsAbsolutePaths(t *testing.T) {
	if _, err := bundle.NewLocal("scene.xml", nil); err == nil {
		t.Error("a relative path was accepted")
	}
}

func FuzzAddArchive(f *testing.F) {
	f.Add(zipped(f, entry{"scene.xml", "<scene/>", 0}))
	f.Add(tarred(f, reg("scene.xml"), reg("a/b.ply")))
	f.Add(gzipped(f, tarred(f, reg("scene.xml"))))
	f.Add(zstdCompressed(f, tarred(f, reg("scene.xml"))))
	limits := bundle.Limits{UploadBytes: 1 << 16, UnpackedBytes: 1 << 16, Files: 4}
	l := library(f, limits)
	f.Fuzz(func(t *testing.T, data []byte) {
		scene, err := l.AddArchive(t.Context(), bytes.NewReader(data))
		if err != nil {
			if !errors.Is(err, job.ErrInvalid) && !errors.Is(err, bundle.ErrTooLarge) {
				t.Errorf("an error that is not the archive's: %v", err)
			}
			return
		}
		var total int64
		for _, file := range scene.Files {
			total += file.Size
			if !blob.ValidPath(file.Path) {
				t.Errorf("path %q was let through", file.Path)
			}
		}
		if total > limits.UnpackedBytes || len(scene.Files) > limits.Files {
			t.Errorf("%d bytes in %d files pass the limits", total, len(scene.Files))
		}
	})
}
