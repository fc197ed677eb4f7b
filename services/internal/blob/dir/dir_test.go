package dir_test

import (
	"errors"
	"os"
	"path/filepath"
	"testing"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/blobtest"
	"metrofarm/services/internal/blob/dir"
)

func TestConformance(t *testing.T) {
	blobtest.Run(t, func(t *testing.T) func() blob.Backend {
		t.Helper()
		place := t.TempDir()
		return func() blob.Backend {
			b, err := dir.Open(place)
			if err != nil {
				t.Fatal(err)
			}
			return b
		}
	})
}

func TestInterruptedWritesAreRemovedWhenOld(t *testing.T) {
	place := t.TempDir()
	b, err := dir.Open(place)
	if err != nil {
		t.Fatal(err)
	}
	old, fresh := filepath.Join(place, "tmp", "write-1"), filepath.Join(place, "tmp", "write-2")
	for _, path := range []string{old, fresh} {
		if err := os.WriteFile(path, []byte("half"), 0o600); err != nil {
			t.Fatal(err)
		}
	}
	hourAgo := time.Now().Add(-time.Hour)
	if err := os.Chtimes(old, hourAgo, hourAgo); err != nil {
		t.Fatal(err)
	}
	if err := b.RemoveUnfinished(t.Context(), time.Now().Add(-time.Minute)); err != nil {
		t.Fatal(err)
	}
	if _, err := os.Stat(old); !errors.Is(err, os.ErrNotExist) {
		t.Errorf("old one: %v", err)
	}
	if _, err := os.Stat(fresh); err != nil {
		t.Errorf("fresh one: %v", err)
	}
}

func TestAPlaceThatIsNoDirectory(t *testing.T) {
	file := filepath.Join(t.TempDir(), "file")
	if err := os.WriteFile(file, nil, 0o600); err != nil {
		t.Fatal(err)
	}
	if _, err := dir.Open(file); err == nil {
		t.Error("a file was accepted")
	}
}
