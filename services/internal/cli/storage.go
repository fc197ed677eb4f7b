package cli

import (
	"errors"
	"fmt"
	"math"
	"path/filepath"
	"strconv"
	"strings"
	"time"

	"github.com/dustin/go-humanize"

	"metrofarm/services/internal/blob/s3"
	"metrofarm/services/internal/bundle"
)

// Storage of a farm.
type Storage struct {
	// BlobDir holds scenes and checkpoints, unless there is a Bucket.
	BlobDir string
	Bucket  *s3.Options
	// AdoptBlobs is the farm whose blobs this one takes over, see farmid.Pair.Claim; "" takes none over.
	AdoptBlobs string
	// Limits of one scene.
	Limits bundle.Limits
	// KeepJobs is how long ended jobs stay, KeepScenes how long scenes that no job uses; 0: for ever.
	KeepJobs, KeepScenes time.Duration
}

// defaultStorage keeps everything below a data folder.
func defaultStorage(data string) Storage {
	return Storage{BlobDir: filepath.Join(data, "blobs"), Limits: bundle.DefaultLimits()}
}

const (
	defaultKeepScenes = 30 * day
	// minKeepScenes is longer than an upload should take.
	minKeepScenes = time.Hour
	day           = 24 * time.Hour
)

// storageFlags are those of serve that say where and how long bytes stay.
type storageFlags struct {
	blobs, adopt, endpoint, region string
	limits                         bundle.Limits
	keepJobs, keepScenes           time.Duration
}

func (s *storageFlags) register(f *flags) {
	f.StringVar(&s.blobs, "blobs", "", "`DIR|s3://BUCKET/PREFIX`: where scenes and checkpoints go, with credentials in "+
		"AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY; default: blobs in --data")
	f.StringVar(&s.adopt, "adopt-blobs", "", "`FARM` whose blobs this one takes over: the one that a refusal to start names; none for "+
		"blobs that bear no farm. For one start")
	f.StringVar(&s.endpoint, "s3-endpoint", "", "`URL` of the S3-compatible store; default: AWS_ENDPOINT_URL, else Amazon's")
	f.StringVar(&s.region, "s3-region", "", "`REGION` of the bucket; default: AWS_REGION, else what the store says")
	s.limits = bundle.DefaultLimits()
	f.Func("max-upload", "`SIZE` of the largest archive that is taken; default 4GiB", bytesInto(&s.limits.UploadBytes))
	f.Func("max-unpacked", "`SIZE` of a scene's files together; default 16GiB", bytesInto(&s.limits.UnpackedBytes))
	f.IntVar(&s.limits.Files, "max-files", s.limits.Files, "`N` files in a scene at most; default 20000")
	f.Func("keep-jobs", "`TIME` after which ended jobs are deleted, such as 36h or 14d; default 0: never", durationInto(&s.keepJobs))
	s.keepScenes = defaultKeepScenes
	f.Func("keep-scenes", "`TIME` after which scenes are deleted that no job uses; 0: never; default 30d", durationInto(&s.keepScenes))
}

func bytesInto(field *int64) func(string) error {
	return func(text string) error {
		n, err := humanize.ParseBytes(text)
		if err != nil || n == 0 || n > math.MaxInt64 {
			return errors.New("want a size above 0, such as 500MB or 4GiB")
		}
		*field = int64(n)
		return nil
	}
}

func durationInto(field *time.Duration) func(string) error {
	return func(text string) error {
		d, err := time.ParseDuration(text)
		if days, found := strings.CutSuffix(text, "d"); found {
			var n float64
			n, err = strconv.ParseFloat(days, 64)
			d = time.Duration(n * float64(day))
		}
		if err != nil || d < 0 {
			return errors.New("want a time such as 90m, 36h or 14d, or 0")
		}
		*field = d
		return nil
	}
}

func (s *storageFlags) check() error {
	switch {
	case s.limits.Files < 1:
		return usagef("--max-files: must be at least 1")
	case s.keepScenes > 0 && s.keepScenes < minKeepScenes:
		return usagef("--keep-scenes: must be 0 or at least %s: uploads must not be overtaken", minKeepScenes)
	case !s.inBucket() && s.endpoint+s.region != "":
		return usagef("--s3-endpoint and --s3-region need --blobs s3://BUCKET/PREFIX")
	case s.endpoint != "":
		if err := s3.CheckEndpoint(s.endpoint); err != nil {
			return usagef("--s3-endpoint: %v", err)
		}
	}
	return nil
}

func (s *storageFlags) inBucket() bool { return strings.Contains(s.blobs, "://") }

func (s *storageFlags) storage(data string, getenv func(string) string) (Storage, error) {
	storage := defaultStorage(data)
	storage.Limits, storage.KeepJobs, storage.KeepScenes, storage.AdoptBlobs = s.limits, s.keepJobs, s.keepScenes, s.adopt
	if !s.inBucket() {
		var err error
		if s.blobs != "" {
			storage.BlobDir, err = filepath.Abs(s.blobs)
		}
		return storage, err
	}
	bucket, prefix, err := s3.ParseLocation(s.blobs)
	if err != nil {
		return Storage{}, usagef("--blobs: %v", err)
	}
	options := &s3.Options{Bucket: bucket, Prefix: prefix, Endpoint: s.endpoint, Region: s.region}
	if err := options.FromEnvironment(getenv); err != nil {
		return Storage{}, fmt.Errorf("--blobs %s: %w", s.blobs, err)
	}
	storage.BlobDir, storage.Bucket = "", options
	return storage, nil
}
