package child_test

import (
	"context"
	"errors"
	"log/slog"
	"os"
	"path/filepath"
	"slices"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/child"
)

// script makes an executable shell script.
func script(t *testing.T, body string) string {
	t.Helper()
	path := filepath.Join(t.TempDir(), child.Program)
	if err := os.WriteFile(path, []byte("#!/bin/sh\n"+body+"\n"), 0o700); err != nil {
		t.Fatal(err)
	}
	return path
}

func TestFiles(t *testing.T) {
	program := script(t, `printf '%s\n' "$@"`)
	files, err := child.Files(t.Context(), program, "/s.xml", []string{"a=1 2", "b=3"}, true)
	want := []string{"files", "/s.xml", "--set", "a=1 2", "--set", "b=3", "--lenient"}
	if err != nil || !slices.Equal(files, want) {
		t.Errorf("%q, error %v; want %q", files, err, want)
	}
}

func TestFilesReportsTheScenesFault(t *testing.T) {
	program := script(t, `echo "metrofarm-worker: s.xml:3: unknown plugin" >&2; exit 1`)
	_, err := child.Files(t.Context(), program, "s.xml", nil, false)
	var scene *child.SceneError
	if !errors.As(err, &scene) || err.Error() != "s.xml:3: unknown plugin" {
		t.Errorf("error %v", err)
	}
}

func TestLocate(t *testing.T) {
	program := script(t, "")
	env := func(value string) func(string) string {
		return func(string) string { return value }
	}
	if got, err := child.Locate(env(program)); err != nil || got != program {
		t.Errorf("%s, error %v", got, err)
	}
	plain := filepath.Join(t.TempDir(), "plain")
	if err := os.WriteFile(plain, nil, 0o600); err != nil {
		t.Fatal(err)
	}
	for _, wrong := range []string{plain, t.TempDir(), "/nowhere/at/all"} {
		if _, err := child.Locate(env(wrong)); err == nil || !strings.Contains(err.Error(), wrong) {
			t.Errorf("%s: error %v", wrong, err)
		}
	}
}

func TestSupervisorRestartsAndStops(t *testing.T) {
	log := filepath.Join(t.TempDir(), "starts")
	// The third life stays until SIGTERM.
	program := script(t, `trap 'echo end >> "$1"; exit 0' TERM; echo x >> "$1"; [ $(wc -l < "$1") -lt 3 ] && exit 1; while :; do sleep 0.01; done`)
	group := child.Start(t.Context(), &child.Supervisor{
		Program: program, Arguments: []string{log}, Logger: slog.New(slog.DiscardHandler), Backoff: time.Millisecond,
	})
	waitFor(t, func() bool { content, _ := os.ReadFile(log); return string(content) == "x\nx\nx\n" })
	group.Stop()
	if content, _ := os.ReadFile(log); string(content) != "x\nx\nx\nend\n" {
		t.Errorf("lives %q: the last was not asked to end", content)
	}
}

func TestSupervisorGivesUpWithTheLastWords(t *testing.T) {
	s := &child.Supervisor{
		Program: script(t, `echo "no such CPU feature" >&2; exit 3`), Logger: slog.New(slog.DiscardHandler),
		Backoff: time.Millisecond, GiveUpAfter: 2,
	}
	err := s.Run(t.Context())
	if err == nil || !strings.Contains(err.Error(), "exit status 3") || !strings.Contains(err.Error(), "no such CPU feature") {
		t.Errorf("error %v", err)
	}
}

func TestSupervisorKillsAWorkerThatWillNotEnd(t *testing.T) {
	s := &child.Supervisor{
		Program: script(t, `trap '' TERM; while :; do sleep 0.01; done`), Logger: slog.New(slog.DiscardHandler),
		Grace: 50 * time.Millisecond,
	}
	ctx, cancel := context.WithTimeout(t.Context(), 100*time.Millisecond)
	defer cancel()
	if err := s.Run(ctx); err != nil { // the worker does not end by itself
		t.Error(err)
	}
}

func waitFor(t *testing.T, condition func() bool) {
	t.Helper()
	for deadline := time.Now().Add(time.Minute); !condition(); time.Sleep(5 * time.Millisecond) {
		if time.Now().After(deadline) {
			t.Fatal("waited in vain")
		}
	}
}
