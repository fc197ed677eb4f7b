package cli

import (
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/bundle"
)

// served returns what serve would start with these arguments.
func served(t *testing.T, environment map[string]string, arguments ...string) (Storage, int, string) {
	t.Helper()
	b := newBench(t, listsScene)
	getenv := b.env.Getenv
	b.env.Getenv = func(name string) string {
		if value, set := environment[name]; set {
			return value
		}
		return getenv(name)
	}
	b.interrupts <- os.Interrupt
	code := b.run(t, append([]string{"serve", "--data", b.path("data")}, arguments...)...)
	return b.farm.options.Storage, code, b.stderr.String()
}

func TestStorageIsInTheDataFolderByDefault(t *testing.T) {
	storage, code, output := served(t, nil)
	if code != 0 || filepath.Base(filepath.Dir(storage.BlobDir)) != "data" || filepath.Base(storage.BlobDir) != "blobs" {
		t.Fatalf("%d, %+v, %s", code, storage, output)
	}
	storage.BlobDir = ""
	if want := (Storage{Limits: bundle.DefaultLimits(), KeepScenes: 30 * 24 * time.Hour}); storage != want {
		t.Errorf("%+v, want %+v", storage, want)
	}
}

func TestStorageFlags(t *testing.T) {
	keys := map[string]string{"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "hidden", "AWS_REGION": "r"}
	storage, code, output := served(t, keys, "--blobs", "s3://farm/one", "--s3-endpoint", "http://127.0.0.1:9000",
		"--max-upload", "500MB", "--max-unpacked", "2GiB", "--max-files", "7", "--keep-jobs", "1.5d", "--keep-scenes", "90m")
	if code != 0 {
		t.Fatal(output)
	}
	want := s3.Options{
		Bucket: "farm", Prefix: "one", Endpoint: "http://127.0.0.1:9000", Region: "r",
		Credentials: s3.Credentials{AccessKey: "key", SecretKey: "hidden"},
	}
	if storage.Bucket == nil || *storage.Bucket != want || storage.BlobDir != "" {
		t.Errorf("bucket %+v, directory %q", storage.Bucket, storage.BlobDir)
	}
	limits := bundle.Limits{UploadBytes: 500_000_000, UnpackedBytes: 2 << 30, Files: 7}
	if storage.Limits != limits || storage.KeepJobs != 36*time.Hour || storage.KeepScenes != 90*time.Minute {
		t.Errorf("%+v", storage)
	}
	storage, code, output = served(t, nil, "--blobs", "elsewhere", "--keep-scenes", "0", "--adopt-blobs", "farm-x")
	if code != 0 || storage.AdoptBlobs != "farm-x" || !filepath.IsAbs(storage.BlobDir) || filepath.Base(storage.BlobDir) != "elsewhere" || storage.KeepScenes != 0 {
		t.Errorf("%d, %+v, %s", code, storage, output)
	}
}

func TestStorageErrors(t *testing.T) {
	for want, arguments := range map[string][]string{
		"AWS_ACCESS_KEY_ID":          {"--blobs", "s3://farm"},
		"s3://BUCKET/PREFIX":         {"--blobs", "https://farm"},
		"no name of a bucket":        {"--blobs", "s3://F"},
		"need --blobs s3://":         {"--s3-region", "r"},
		"http://HOST:PORT":           {"--blobs", "s3://farm", "--s3-endpoint", "127.0.0.1:9000"},
		"-max-upload: want a size":   {"--max-upload", "big"},
		"-max-unpacked: want a size": {"--max-unpacked", "0"},
		"--max-files: must be":       {"--max-files", "0"},
		"--keep-scenes: must be":     {"--keep-scenes", "5m"},
		"-keep-jobs: want a time":    {"--keep-jobs", "-1h"},
		"-keep-scenes: want a time":  {"--keep-scenes", "xd"},
	} {
		if _, code, output := served(t, nil, arguments...); code == 0 || !strings.Contains(output, want) {
			t.Errorf("%v: exit code %d, %q; want %q", arguments, code, output, want)
		}
	}
}
