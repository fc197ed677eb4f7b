package localfarm_test

import (
	"log/slog"
	"net"
	"net/http"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/localfarm"
)

func options(t *testing.T) cli.FarmOptions {
	t.Helper()
	data := t.TempDir()
	return cli.FarmOptions{
		DataDir: data, Storage: cli.Storage{BlobDir: filepath.Join(data, "blobs"), Limits: bundle.DefaultLimits()},
		Listen: "127.0.0.1:0", FarmListen: "127.0.0.1:0", LocalOnly: true,
		Logger: slog.New(slog.DiscardHandler),
	}
}

func TestServesAndKeepsJobsOverARestart(t *testing.T) {
	o := options(t)
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	for _, path := range []string{"readyz", "metrics", "v1/jobs"} {
		response, err := http.Get(farm.Dashboard() + path)
		if err != nil {
			t.Fatal(err)
		}
		response.Body.Close()
		if response.StatusCode != http.StatusOK {
			t.Errorf("%s: %s", path, response.Status)
		}
	}
	if _, err := farm.Service().Submit(t.Context(), job.Request{Scene: strings.Repeat("0", 64), Entry: "x"}, ""); err == nil {
		t.Error("a job without a stored scene was accepted")
	}
	if err := farm.Close(); err != nil {
		t.Fatal(err)
	}
	again, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	if err := again.Close(); err != nil {
		t.Error(err)
	}
}

func TestAFailedStartLeavesNothingRunning(t *testing.T) {
	taken, err := net.Listen("tcp", "127.0.0.1:0")
	if err != nil {
		t.Fatal(err)
	}
	defer taken.Close()
	o := options(t)
	o.Listen = taken.Addr().String()
	if _, err := localfarm.Start(t.Context(), o); err == nil || !strings.Contains(err.Error(), "dashboard") {
		t.Fatalf("error %v", err)
	}
	o.Listen = "" // the data folder must be free again
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	if err := farm.Close(); err != nil {
		t.Error(err)
	}
}

func TestAWorkerThatCannotRunFailsTheFarm(t *testing.T) {
	program := filepath.Join(t.TempDir(), "worker")
	if err := os.WriteFile(program, []byte("#!/bin/sh\necho \"$@\"\nexit 1\n"), 0o700); err != nil {
		t.Fatal(err)
	}
	o := options(t)
	o.Workers, o.Threads, o.SceneMemory, o.WorkerProgram, o.OneJob = 1, 2, 12345, program, true
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	select {
	case err := <-farm.Failed():
		for _, told := range []string{"--coordinator 127.0.0.1:", "--threads 2", "--scene-memory 12345"} {
			if !strings.Contains(err.Error(), told) {
				t.Errorf("it was not started with %s: %v", told, err)
			}
		}
	case <-time.After(20 * time.Second):
		t.Error("the farm did not notice")
	}
	if err := farm.Close(); err != nil {
		t.Error(err)
	}
}
