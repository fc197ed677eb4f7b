package localfarm_test

import (
	"archive/zip"
	"bytes"
	"encoding/json"
	"errors"
	"io"
	"log/slog"
	"net/http"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"github.com/alicebob/miniredis/v2"

	"metrofarm/services/internal/blob/s3/s3test"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/farmid"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/localfarm"
)

// upload posts a scene of one file and returns what the farm says.
func upload(t *testing.T, farm *localfarm.Farm, content string) (int, bundle.Scene) {
	t.Helper()
	var archive bytes.Buffer
	w := zip.NewWriter(&archive)
	f, err := w.Create("scene.xml")
	if err == nil {
		_, err = io.WriteString(f, content)
	}
	if err == nil {
		err = w.Close()
	}
	if err != nil {
		t.Fatal(err)
	}
	response, err := http.Post(farm.Dashboard()+"v1/scenes", "application/zip", &archive)
	if err != nil {
		t.Fatal(err)
	}
	defer response.Body.Close()
	var scene bundle.Scene
	if err := json.NewDecoder(response.Body).Decode(&scene); err != nil {
		t.Fatal(err)
	}
	return response.StatusCode, scene
}

func start(t *testing.T, o cli.FarmOptions) *localfarm.Farm {
	t.Helper()
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	return farm
}

func TestScenesLieInABucket(t *testing.T) {
	server := s3test.Start(t)
	bucket := server.Bucket()
	o := options(t)
	o.Storage = cli.Storage{Bucket: &bucket, Limits: bundle.DefaultLimits()}
	o.Store = "redis://" + miniredis.RunT(t).Addr() + "/0"
	farm := start(t, o)
	status, scene := upload(t, farm, "<scene/>")
	if status != http.StatusCreated {
		t.Fatalf("upload: %d", status)
	}
	if err := farm.Close(); err != nil {
		t.Fatal(err)
	}
	// Another machine: nothing but the store and the bucket is the same.
	o.DataDir = t.TempDir()
	farm = start(t, o)
	snapshot, err := farm.Service().Submit(t.Context(), job.Request{Scene: scene.Digest, Entry: "scene.xml"}, "")
	if err != nil || snapshot.ID == "" {
		t.Errorf("submitting what the first one stored: %v", err)
	}
	if err := farm.Close(); err != nil {
		t.Fatal(err)
	}
	if entries, err := os.ReadDir(filepath.Join(o.DataDir, "blobs")); err == nil {
		t.Errorf("blobs in the data folder: %v", entries)
	}
}

func TestAMissingBucketIsAnErrorAtTheStart(t *testing.T) {
	server := s3test.Start(t)
	bucket := server.Bucket()
	bucket.Bucket = "missing"
	o := options(t)
	o.Storage = cli.Storage{Bucket: &bucket}
	if _, err := localfarm.Start(t.Context(), o); err == nil || !strings.Contains(err.Error(), "--blobs") {
		t.Errorf("error %v", err)
	}
}

// TestFarmsDoNotShareBlobs: they would delete each other's, whether they share a server or not.
func TestFarmsDoNotShareBlobs(t *testing.T) {
	server := "redis://" + miniredis.RunT(t).Addr() + "/0"
	for name, stores := range map[string][2]string{"prefixes": {server + "?prefix=one", server + "?prefix=two"}, "files": {}} {
		t.Run(name, func(t *testing.T) {
			one, two := options(t), options(t)
			one.Store, two.Store = stores[0], stores[1]
			if err := start(t, one).Close(); err != nil {
				t.Fatal(err)
			}
			two.Storage.BlobDir = one.Storage.BlobDir
			_, err := localfarm.Start(t.Context(), two)
			if !errors.Is(err, farmid.ErrMismatch) {
				t.Fatalf("error %v", err)
			}
			_, after, _ := strings.Cut(err.Error(), "--adopt-blobs ")
			two.Storage.AdoptBlobs, _, _ = strings.Cut(after, " ")
			if err := start(t, two).Close(); err != nil {
				t.Fatal(err)
			}
			if _, err := localfarm.Start(t.Context(), one); !errors.Is(err, farmid.ErrMismatch) {
				t.Errorf("the farm whose blobs were taken: %v", err)
			}
		})
	}
}

// TestBlobsMustBeShared: coordinators of one farm that do not see each other's would begin jobs again.
func TestBlobsMustBeShared(t *testing.T) {
	one, two := options(t), options(t)
	one.Store = "redis://" + miniredis.RunT(t).Addr() + "/0"
	two.Store = one.Store
	farm := start(t, one)
	if _, err := localfarm.Start(t.Context(), two); !errors.Is(err, farmid.ErrMismatch) {
		t.Errorf("error %v", err)
	}
	if err := farm.Close(); err != nil {
		t.Error(err)
	}
}

// TestAStoreThatWasEmptied: all blobs would be taken for unused.
func TestAStoreThatWasEmptied(t *testing.T) {
	o := options(t)
	server := miniredis.RunT(t)
	o.Store = "redis://" + server.Addr() + "/0"
	farm := start(t, o)
	if status, _ := upload(t, farm, "<scene/>"); status != http.StatusCreated {
		t.Fatalf("upload: %d", status)
	}
	server.FlushAll()
	if err := farm.Close(); err != nil {
		t.Error(err)
	}
	if _, err := localfarm.Start(t.Context(), o); !errors.Is(err, farmid.ErrMismatch) {
		t.Errorf("error %v", err)
	}
}

func TestLimitsReachTheUploads(t *testing.T) {
	o := options(t)
	o.Storage.Limits.UnpackedBytes = 100
	farm := start(t, o)
	for size, want := range map[int]int{100: http.StatusCreated, 101: http.StatusRequestEntityTooLarge} {
		if status, _ := upload(t, farm, strings.Repeat("x", size)); status != want {
			t.Errorf("%d bytes: status %d, want %d", size, status, want)
		}
	}
	if err := farm.Close(); err != nil {
		t.Error(err)
	}
}

// TestOldThingsAreSweptAtTheStart: the sweeper runs with the farm's store and blobs.
func TestOldThingsAreSweptAtTheStart(t *testing.T) {
	o := options(t)
	var log bytes.Buffer
	farm := start(t, o)
	_, scene := upload(t, farm, "<scene/>")
	snapshot, err := farm.Service().Submit(t.Context(), job.Request{Scene: scene.Digest, Entry: "scene.xml"}, "")
	if err == nil {
		_, err = farm.Service().Cancel(t.Context(), snapshot.ID)
	}
	if err == nil {
		err = farm.Close()
	}
	if err != nil {
		t.Fatal(err)
	}
	o.Storage.KeepJobs = 1 // nanosecond
	o.Logger = slog.New(slog.NewTextHandler(&log, nil))
	farm = start(t, o)
	for {
		jobs, _, err := farm.Service().Jobs(t.Context(), "", 10)
		if err != nil {
			t.Fatal(err)
		}
		if len(jobs) == 0 {
			break
		}
		time.Sleep(time.Millisecond)
	}
	if err := farm.Close(); err != nil {
		t.Fatal(err)
	}
	if !strings.Contains(log.String(), "msg=swept jobs=1") {
		t.Errorf("the log does not tell: %s", log.String())
	}
}
