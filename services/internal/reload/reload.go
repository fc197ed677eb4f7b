// Package reload reads files again when they change, or when it is told to.
package reload

import (
	"context"
	"log/slog"
	"os"
	"slices"
	"time"
)

// Source is something that was read from files.
type Source struct {
	// Name for the log.
	Name string
	// Files that it was read from.
	Files []string
	// Reload reads them again; on an error, what was read before stays.
	Reload func() error
}

// Watcher looks at the files of its sources from time to time. It follows symbolic links, as those
// that a mounted secret consists of, and needs no support of the file system.
type Watcher struct {
	Sources []Source
	// Every so often it looks.
	Every time.Duration
	// Now makes it read everything, changed or not; nil: never.
	Now    <-chan os.Signal
	Logger *slog.Logger
}

// Run watches until ctx ends.
func (w *Watcher) Run(ctx context.Context) {
	seen := make([][]os.FileInfo, len(w.Sources))
	for i, source := range w.Sources {
		seen[i] = statOf(source.Files)
	}
	ticker := time.NewTicker(w.Every)
	defer ticker.Stop()
	for {
		all := false
		select {
		case <-ctx.Done():
			return
		case <-ticker.C:
		case <-w.Now:
			all = true
		}
		for i, source := range w.Sources {
			now := statOf(source.Files)
			if all || !same(seen[i], now) {
				seen[i] = now
				w.reload(source)
			}
		}
	}
}

func (w *Watcher) reload(source Source) {
	if err := source.Reload(); err != nil {
		w.Logger.Error("reading again failed; what was read before stays in force",
			slog.String("what", source.Name), slog.Any("error", err))
		return
	}
	w.Logger.Info("read again", slog.String("what", source.Name))
}

// statOf the files; nil for one that cannot be seen.
func statOf(files []string) []os.FileInfo {
	infos := make([]os.FileInfo, len(files))
	for i, file := range files {
		if info, err := os.Stat(file); err == nil {
			infos[i] = info
		}
	}
	return infos
}

func same(before, now []os.FileInfo) bool {
	return slices.EqualFunc(before, now, func(a, b os.FileInfo) bool {
		if a == nil || b == nil {
			return a == b
		}
		return os.SameFile(a, b) && a.ModTime().Equal(b.ModTime()) && a.Size() == b.Size()
	})
}
