package localfarm

import (
	"context"
	"errors"
	"fmt"
	"io/fs"
	"os"
	"path/filepath"
	"strings"
	"time"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/blob/dir"
	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/store/bolt"
	"metrofarm/services/internal/store/redis"
	"metrofarm/services/internal/sweep"
)

// uploadsStaleAfter is the age from which uploads are what a crashed process left behind.
const uploadsStaleAfter = 24 * time.Hour

// openStore opens the file or reaches the server.
func (f *Farm) openStore(ctx context.Context) error {
	if strings.Contains(f.options.Store, "://") {
		db, err := redis.Open(ctx, f.options.Store, redis.Options{Logger: f.options.Logger})
		if err != nil {
			return err
		}
		f.db = db
		return nil
	}
	db, err := bolt.Open(filepath.Join(f.options.DataDir, "metrofarm.db"), nil)
	if err != nil {
		return fmt.Errorf("data folder %s (used by another coordinator?): %w", f.options.DataDir, err)
	}
	f.db = db
	return nil
}

// openBlobs opens the directory or the bucket, and the library of scenes in it. Uploads on their way
// there lie in a folder that coordinators may share.
func (f *Farm) openBlobs(ctx context.Context) (*blob.Store, error) {
	uploads := filepath.Join(f.options.DataDir, "uploads")
	if err := clearStale(uploads); err != nil {
		return nil, fmt.Errorf("the folder for uploads: %w", err)
	}
	backend, err := openBackend(ctx, f.options.Storage.BlobDir, f.options.Storage.Bucket, uploads)
	if err != nil {
		return nil, err
	}
	blobs := blob.New(backend)
	f.library = bundle.NewLibrary(blobs, f.options.Storage.Limits, uploads)
	return blobs, nil
}

// clearStale makes folder if there is none, and removes what crashed processes left in it.
func clearStale(folder string) error {
	if err := os.MkdirAll(folder, 0o750); err != nil {
		return err
	}
	entries, err := os.ReadDir(folder)
	if err != nil {
		return err
	}
	for _, entry := range entries {
		info, err := entry.Info()
		if err == nil && time.Since(info.ModTime()) > uploadsStaleAfter {
			err = os.RemoveAll(filepath.Join(folder, entry.Name()))
		}
		if err != nil && !errors.Is(err, fs.ErrNotExist) { // another process was faster
			return err
		}
	}
	return nil
}

func openBackend(ctx context.Context, folder string, bucket *s3.Options, uploads string) (blob.Backend, error) {
	if bucket == nil {
		return dir.Open(folder)
	}
	options := *bucket
	options.SpoolDir = uploads
	return s3.Open(ctx, options)
}

// startSweeping deletes what is no longer needed, until ctx ends.
func (f *Farm) startSweeping(ctx context.Context, blobs *blob.Store) {
	sweeper := sweep.New(sweep.Options{
		Blobs: blobs, Jobs: sweep.StoredJobs{Store: f.db, Coordinator: f.coordinator}, Logger: f.options.Logger,
		KeepJobs: f.options.Storage.KeepJobs, KeepScenes: f.options.Storage.KeepScenes,
		SameFarm: func(ctx context.Context) error { return f.pair.Check(ctx, f.id) },
	})
	f.wait.Go(func() { sweeper.Run(ctx) })
}
