package localfarm_test

import (
	"archive/zip"
	"bytes"
	"encoding/json"
	"io"
	"log/slog"
	"net/http"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/blob/s3/s3test"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/cli"
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
	farm := start(t, o)
	status, scene := upload(t, farm, "<scene/>")
	if status != http.StatusCreated {
		t.Fatalf("upload: %d", status)
	}
	if err := farm.Close(); err != nil {
		t.Fatal(err)
	}
	// Another machine: nothing but the bucket is the same.
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
