package sweep_test

import (
	"context"
	"errors"
	"fmt"
	"io"
	"iter"
	"slices"
	"strings"
	"testing"
	"testing/synctest"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/blob/s3/s3test"
	"metrofarm/services/internal/sweep"
)

const (
	keepJobs   = 48 * time.Hour
	keepScenes = 24 * time.Hour
)

// fakeJobs is a list of jobs.
type fakeJobs struct {
	jobs   []sweep.Job
	broken error
	stuck  string
}

func (f *fakeJobs) Jobs(context.Context) ([]sweep.Job, error) { return slices.Clone(f.jobs), f.broken }

func (f *fakeJobs) Delete(_ context.Context, old sweep.Job) error {
	if old.ID == f.stuck {
		return errors.New("stuck")
	}
	f.jobs = slices.DeleteFunc(f.jobs, func(j sweep.Job) bool { return j == old })
	return nil
}

// fixture is a sweeper whose clock runs ahead of the blobs' by what the test says.
type fixture struct {
	*testing.T
	blobs   *blob.Store
	jobs    *fakeJobs
	strange error // what is wrong with the farm
	ahead   time.Duration
	sweeper *sweep.Sweeper
}

func newFixture(t *testing.T, backend blob.Backend) *fixture {
	t.Helper()
	if backend == nil {
		var err error
		if backend, err = dir.Open(t.TempDir()); err != nil {
			t.Fatal(err)
		}
	}
	f := &fixture{T: t, blobs: blob.New(backend), jobs: &fakeJobs{}}
	f.sweeper = f.another()
	return f
}

// another is the sweeper of another coordinator.
func (f *fixture) another() *sweep.Sweeper {
	return sweep.New(sweep.Options{
		Blobs: f.blobs, Jobs: f.jobs, KeepJobs: keepJobs, KeepScenes: keepScenes,
		SameFarm: func(context.Context) error { return f.strange },
		Now:      func() time.Time { return time.Now().Add(f.ahead) },
	})
}

// scene stores a bundle of files with these contents.
func (f *fixture) scene(contents ...string) string {
	f.Helper()
	files := make([]blob.File, 0, len(contents))
	for i, content := range contents {
		files = append(files, f.file(fmt.Sprintf("file-%d", i), content))
	}
	digest, err := f.blobs.PutManifest(f.Context(), files)
	f.check(err)
	return digest
}

func (f *fixture) file(path, content string) blob.File {
	f.Helper()
	sha, size, err := f.blobs.PutFile(f.Context(), strings.NewReader(content), 1<<20)
	f.check(err)
	return blob.File{Path: path, Size: size, SHA256: sha}
}

func (f *fixture) named(name string) {
	f.Helper()
	f.check(f.blobs.WriteBlob(f.Context(), name, func(io.Writer) error { return nil }))
}

func (f *fixture) check(err error) {
	f.Helper()
	if err != nil {
		f.Fatal(err)
	}
}

func (f *fixture) sweep(want sweep.Counts) {
	f.Helper()
	got, err := f.sweeper.Sweep(f.Context())
	f.check(err)
	if got != want {
		f.Errorf("swept %+v, want %+v", got, want)
	}
}

func (f *fixture) left(kind blob.Kind) int {
	f.Helper()
	count := 0
	for _, err := range f.blobs.List(f.Context(), kind) {
		f.check(err)
		count++
	}
	return count
}

// whole tells whether a bundle can be had.
func (f *fixture) whole(digest string) bool {
	f.Helper()
	files, err := f.blobs.Manifest(f.Context(), digest)
	if errors.Is(err, blob.ErrNotFound) {
		return false
	}
	f.check(err)
	for _, file := range files {
		r, err := f.blobs.OpenFile(f.Context(), file.SHA256)
		f.check(err)
		f.check(r.Close())
	}
	return true
}

func TestUnusedBundlesGo(t *testing.T) {
	t.Run("directory", func(t *testing.T) { testUnusedBundlesGo(t, nil) })
	t.Run("bucket", func(t *testing.T) {
		backend, err := s3.Open(t.Context(), s3test.Start(t).Bucket())
		if err != nil {
			t.Fatal(err)
		}
		testUnusedBundlesGo(t, backend)
	})
}

func testUnusedBundlesGo(t *testing.T, backend blob.Backend) {
	f := newFixture(t, backend)
	used := f.scene("shared", "of the used one")
	unused := f.scene("shared", "of the unused one")
	f.file("a", "of no bundle")
	f.jobs.jobs = []sweep.Job{{ID: "j", Scene: used}}

	f.sweep(sweep.Counts{})
	f.sweep(sweep.Counts{}) // all is young
	f.ahead = keepScenes + time.Hour
	f.sweep(sweep.Counts{}) // first to find something unused
	f.sweep(sweep.Counts{Manifests: 1, Files: 1})
	if f.whole(unused) || !f.whole(used) {
		t.Error("the wrong bundle is gone")
	}
	f.sweep(sweep.Counts{}) // first to miss the bundle of its file
	f.sweep(sweep.Counts{Files: 1})
	if !f.whole(used) || f.left(blob.Files) != 2 {
		t.Errorf("%d files are left, want 2", f.left(blob.Files))
	}
	f.jobs.jobs = nil
	for range 4 {
		_, err := f.sweeper.Sweep(t.Context())
		f.check(err)
	}
	if f.left(blob.Files)+f.left(blob.Manifests) != 0 {
		t.Error("something is left")
	}
}

func TestUseKeeps(t *testing.T) {
	f := newFixture(t, nil)
	f.scene("a")
	f.ahead = keepScenes + time.Hour
	f.sweep(sweep.Counts{})
	f.ahead = 0 // as if all were renewed
	f.scene("a")
	f.sweep(sweep.Counts{})
	f.sweep(sweep.Counts{})
	if f.left(blob.Manifests) != 1 {
		t.Error("the bundle is gone")
	}
}

// TestAJobInTheNickOfTime: a job is stored after the pass that removed its bundle has read the jobs.
func TestAJobInTheNickOfTime(t *testing.T) {
	f := newFixture(t, nil)
	digest := f.scene("a", "b")
	f.ahead = keepScenes + time.Hour
	f.sweep(sweep.Counts{})
	f.sweep(sweep.Counts{Manifests: 1})
	f.jobs.jobs = []sweep.Job{{ID: "j", Scene: digest}}
	f.sweep(sweep.Counts{PutBack: 1})
	for range 3 {
		f.sweep(sweep.Counts{})
	}
	if !f.whole(digest) {
		t.Error("the bundle is gone")
	}
}

func TestTwoSweepers(t *testing.T) {
	f := newFixture(t, nil)
	kept := f.scene("a", "shared")
	f.jobs.jobs = []sweep.Job{{ID: "j", Scene: kept}}
	for i := range 50 {
		f.scene(fmt.Sprintf("of bundle %d", i), "shared")
	}
	f.ahead = keepScenes + time.Hour
	done := make(chan error)
	for range 2 {
		go func() {
			sweeper := f.another()
			var failed error
			for range 5 {
				_, err := sweeper.Sweep(f.Context())
				failed = errors.Join(failed, err)
			}
			done <- failed
		}()
	}
	f.check(errors.Join(<-done, <-done))
	if !f.whole(kept) || f.left(blob.Manifests) != 1 || f.left(blob.Files) != 2 {
		t.Errorf("left %d manifests and %d files", f.left(blob.Manifests), f.left(blob.Files))
	}
}

func TestOldJobsGoWithTheirCheckpoints(t *testing.T) {
	f := newFixture(t, nil)
	digest := f.scene("a")
	now := time.Now()
	f.jobs.jobs = []sweep.Job{
		{ID: "running", Scene: digest, Checkpoint: "checkpoint-running"},
		{ID: "old", Scene: digest, Checkpoint: "checkpoint-old", KeptFrom: now.Add(-keepJobs)},
		{ID: "stuck", Scene: digest, Checkpoint: "checkpoint-stuck", KeptFrom: now.Add(-keepJobs)},
		{ID: "young", Scene: digest, Checkpoint: "checkpoint-young", KeptFrom: now},
	}
	f.jobs.stuck = "stuck"
	for _, name := range []string{"running", "old", "stuck", "young", "unswung"} {
		f.named("checkpoint-" + name)
	}
	f.named("of-another-kind")
	f.sweep(sweep.Counts{Jobs: 1})
	f.sweep(sweep.Counts{}) // its checkpoint is young
	f.ahead = 2 * time.Hour
	f.sweep(sweep.Counts{})
	f.sweep(sweep.Counts{Checkpoints: 2})
	if f.left(blob.Named) != 4 || len(f.jobs.jobs) != 3 {
		t.Errorf("%d blobs and jobs %+v are left", f.left(blob.Named), f.jobs.jobs)
	}
}

func TestNothingGoesWhereNotAllIsKnown(t *testing.T) {
	f := newFixture(t, nil)
	f.file("a", "of no bundle")
	f.named("checkpoint-1")
	f.ahead = 1000 * time.Hour
	f.sweep(sweep.Counts{})
	f.jobs.broken = errors.New("the store is away")
	if _, err := f.sweeper.Sweep(t.Context()); !errors.Is(err, f.jobs.broken) {
		t.Errorf("error %v", err)
	}
	if f.left(blob.Files) != 1 || f.left(blob.Named) != 1 {
		t.Error("something was deleted without knowledge of the jobs")
	}
}

// TestNothingGoesThatIsAnotherFarms: the store was emptied, or others took the blobs, while the process ran.
func TestNothingGoesThatIsAnotherFarms(t *testing.T) {
	f := newFixture(t, nil)
	digest := f.scene("a")
	f.named("checkpoint-1")
	f.ahead = 1000 * time.Hour
	f.sweep(sweep.Counts{})
	f.jobs.jobs = []sweep.Job{{ID: "old", KeptFrom: time.Unix(0, 0)}}
	f.strange = errors.New("another farm")
	for range 3 {
		if counts, err := f.sweeper.Sweep(t.Context()); !errors.Is(err, f.strange) || counts != (sweep.Counts{}) {
			t.Errorf("swept %+v, error %v", counts, err)
		}
	}
	if !f.whole(digest) || f.left(blob.Named) != 1 || len(f.jobs.jobs) != 1 {
		t.Error("something was deleted")
	}
}

// TestAPassThatFailsForgetsNothing: it removed a bundle before it failed, and the next one puts it back.
func TestAPassThatFailsForgetsNothing(t *testing.T) {
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	failing := &failingBackend{Backend: backend}
	f := newFixture(t, failing)
	digest := f.scene("a")
	f.ahead = keepScenes + time.Hour
	f.sweep(sweep.Counts{})
	failing.kind = blob.Files
	if counts, err := f.sweeper.Sweep(t.Context()); err == nil || counts.Manifests != 1 {
		t.Fatalf("swept %+v, %v", counts, err)
	}
	failing.kind = ""
	f.jobs.jobs = []sweep.Job{{ID: "j", Scene: digest}}
	f.sweep(sweep.Counts{PutBack: 1})
	if !f.whole(digest) {
		t.Error("the bundle is gone")
	}
}

// TestAStoreThatHidesUploadsIsSwept: what failed is told, and the rest goes on.
func TestAStoreThatHidesUploadsIsSwept(t *testing.T) {
	backend, err := dir.Open(t.TempDir())
	if err != nil {
		t.Fatal(err)
	}
	f := newFixture(t, &failingBackend{Backend: backend, hides: true})
	f.file("a", "of no bundle")
	f.ahead = keepScenes + time.Hour
	for range 2 {
		if _, err := f.sweeper.Sweep(t.Context()); !errors.Is(err, errHidden) {
			t.Errorf("error %v", err)
		}
	}
	if f.left(blob.Files) != 0 {
		t.Error("the file is left")
	}
}

var errHidden = errors.New("hidden")

// failingBackend does not list blobs of one kind, or no unfinished uploads.
type failingBackend struct {
	blob.Backend
	kind  blob.Kind
	hides bool
}

func (b *failingBackend) List(ctx context.Context, kind blob.Kind) iter.Seq2[blob.Info, error] {
	if kind == b.kind {
		return func(yield func(blob.Info, error) bool) { yield(blob.Info{}, errHidden) }
	}
	return b.Backend.List(ctx, kind)
}

func (b *failingBackend) RemoveUnfinished(ctx context.Context, before time.Time) error {
	if b.hides {
		return errHidden
	}
	return b.Backend.RemoveUnfinished(ctx, before)
}

func TestKeepForEver(t *testing.T) {
	f := newFixture(t, nil)
	f.scene("a")
	f.jobs.jobs = []sweep.Job{{ID: "j", KeptFrom: time.Now().Add(-time.Hour)}}
	f.sweeper = sweep.New(sweep.Options{
		Blobs: f.blobs, Jobs: f.jobs, Now: func() time.Time { return time.Now().Add(100_000 * time.Hour) },
	})
	for range 3 {
		f.sweep(sweep.Counts{})
	}
}

// A process that lives for two minutes deletes what is unused.
func TestTheSecondPassComesSoon(t *testing.T) {
	f := newFixture(t, nil)
	f.file("a", "of no bundle")
	synctest.Test(t, func(t *testing.T) {
		sweeper := sweep.New(sweep.Options{
			Blobs: f.blobs, Jobs: f.jobs, KeepScenes: keepScenes,
			Now: func() time.Time { return time.Now().Add(1_000_000 * time.Hour) }, // later than the files by far
		})
		ctx, cancel := context.WithTimeout(t.Context(), 2*time.Minute)
		defer cancel()
		sweeper.Run(ctx)
	})
	if n := f.left(blob.Files); n > 0 {
		t.Errorf("%d files are left", n)
	}
}

func TestRunSweepsAndEnds(t *testing.T) {
	f := newFixture(t, nil)
	f.file("a", "of no bundle")
	f.ahead = keepScenes + time.Hour
	sweeper := sweep.New(sweep.Options{
		Blobs: f.blobs, Jobs: f.jobs, KeepScenes: keepScenes, Interval: time.Millisecond,
		Now: func() time.Time { return time.Now().Add(f.ahead) },
	})
	ctx, cancel := context.WithCancel(t.Context())
	done := make(chan struct{})
	go func() { defer close(done); sweeper.Run(ctx) }()
	for f.left(blob.Files) > 0 {
		time.Sleep(time.Millisecond)
	}
	cancel()
	<-done
}
