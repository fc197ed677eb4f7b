package reload_test

import (
	"context"
	"errors"
	"log/slog"
	"os"
	"path/filepath"
	"testing"
	"time"

	"metrofarm/services/internal/reload"
)

const patience = 10 * time.Second

func expectReload(t *testing.T, reloaded <-chan struct{}, after string) {
	t.Helper()
	select {
	case <-reloaded:
	case <-time.After(patience):
		t.Fatalf("not read again after %s", after)
	}
}

func TestFilesAreReadAgain(t *testing.T) {
	dir := t.TempDir()
	write := func(name, content string) string {
		path := filepath.Join(dir, name)
		// In one step: half of a change would count as another one.
		if err := errors.Join(os.WriteFile(path+".part", []byte(content), 0o600), os.Rename(path+".part", path)); err != nil {
			t.Fatal(err)
		}
		return path
	}
	// As a mounted secret: a link to what is replaced whole.
	old := write("old", "same size")
	replacement := write("new", "same size")
	if info, err := os.Stat(old); err != nil || os.Chtimes(replacement, info.ModTime(), info.ModTime()) != nil {
		t.Fatal(err)
	}
	link := filepath.Join(dir, "link")
	if err := os.Symlink(old, link); err != nil {
		t.Fatal(err)
	}
	plain := write("plain", "1")
	reloaded, quiet := make(chan struct{}, 100), make(chan struct{}, 100)
	hangups := make(chan os.Signal)
	watcher := reload.Watcher{
		Sources: []reload.Source{
			{Name: "watched", Files: []string{link, plain}, Reload: func() error {
				reloaded <- struct{}{}
				return errors.New("goes on after an error")
			}},
			{Name: "untouched", Files: []string{write("other", "")}, Reload: func() error {
				quiet <- struct{}{}
				return nil
			}},
		},
		Every: time.Millisecond, Now: hangups, Logger: slog.New(slog.DiscardHandler),
	}
	ctx, cancel := context.WithCancel(t.Context())
	ended := make(chan struct{})
	go func() {
		watcher.Run(ctx)
		close(ended)
	}()
	hangups <- os.Interrupt // by then it has looked at the files
	expectReload(t, reloaded, "a signal")
	expectReload(t, quiet, "a signal")
	write("plain", "22")
	expectReload(t, reloaded, "a change")
	if err := os.Symlink(replacement, link+"2"); err != nil || os.Rename(link+"2", link) != nil {
		t.Fatal(err)
	}
	expectReload(t, reloaded, "a link's change")
	if err := os.Remove(plain); err != nil {
		t.Fatal(err)
	}
	expectReload(t, reloaded, "a removal")
	cancel()
	<-ended
	if len(quiet) != 0 {
		t.Error("a file that did not change was read again")
	}
}
