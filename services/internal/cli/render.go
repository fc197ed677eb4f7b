package cli

import (
	"context"
	"errors"
	"fmt"
	"io"
	"log/slog"
	"os"
	"path/filepath"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/child"
	"metrofarm/services/internal/exr"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/preview"
)

// renderFlags are the flags of render beside those of the job.
type renderFlags struct {
	requestFlags
	frameFlags
	out, stats, png  string
	half             bool
	threads, workers int
	data, listen     string
	verbose          bool
}

func (r *renderFlags) register(f *flags) {
	r.requestFlags.register(f)
	r.frameFlags.register(f)
	f.StringVar(&r.out, "o", "", "write the image to `OUT.exr`; required")
	f.StringVar(&r.stats, "stats", "", "write statistics to `OUT.json`")
	f.StringVar(&r.png, "png", "", "write a tone-mapped picture to `OUT.png`")
	f.BoolVar(&r.half, "half", false, "store 16-bit floats")
	f.IntVar(&r.threads, "threads", 0, "`N` render threads per worker; default: all")
	f.IntVar(&r.workers, "workers", 1, "`N` local worker processes")
	f.StringVar(&r.data, "data", "", "keep checkpoints in `DIR`; default: a temporary one, removed at the end")
	f.StringVar(&r.listen, "listen", "", "show the dashboard at `ADDRESS` meanwhile, for example 127.0.0.1:8080")
	f.BoolVar(&r.verbose, "verbose", false, "log what the coordinator and the workers do")
}

func (r *renderFlags) complete() error {
	switch {
	case r.out == "":
		return usagef("render: -o OUT.exr is missing")
	case r.threads < 0:
		return usagef("--threads: must not be negative")
	case r.workers < 1:
		return usagef("--workers: render needs at least one")
	}
	if r.listen != "" {
		local, err := isLocal(r.listen)
		if err != nil {
			return err
		}
		if !local {
			return usagef("--listen %s can be reached by other machines; use 127.0.0.1, or metrofarm serve with --tokens", r.listen)
		}
	}
	outputs := []string{r.out, r.stats, r.png}
	return errors.Join(checkOutputs(outputs...), r.finish(), r.check(r.request, outputs...))
}

func render(ctx context.Context, env Env, arguments []string) error {
	var r renderFlags
	f := newFlags("render", env)
	r.register(f)
	positional, err := f.parse(arguments, 1, 1)
	if err != nil {
		return ignoreHelp(err)
	}
	if err := r.complete(); err != nil {
		return err
	}
	program, err := child.Locate(env.Getenv)
	if err != nil {
		return err
	}
	local, err := localScene(ctx, program, positional[0], &r.requestFlags)
	if err != nil {
		return err
	}
	data, remove, err := dataDir(r.data)
	if err != nil {
		return err
	}
	defer remove()
	farm, err := env.StartFarm(ctx, FarmOptions{
		DataDir: data, Storage: defaultStorage(data), Listen: r.listen, LocalOnly: true, FarmListen: "127.0.0.1:0",
		Workers: r.workers, Threads: threadsPerWorker(env.CPUs, r.threads, r.workers),
		SceneMemory:   sceneMemory(env.Memory, r.workers),
		WorkerProgram: program, OneJob: true, Version: env.Version, Logger: logger(env.Stderr, r.verbose),
	})
	if err != nil {
		return err
	}
	return errors.Join(r.renderOn(ctx, env, farm, local), farm.Close())
}

func (r *renderFlags) renderOn(ctx context.Context, env Env, farm Farm, local bundle.Local) error {
	show := &reporter{w: env.Stderr, terminal: env.Terminal}
	if farm.Dashboard() != "" {
		show.say("dashboard: %s", farm.Dashboard())
	}
	scene, err := farm.AddScene(ctx, local)
	if err != nil {
		return err
	}
	r.request.Scene, r.request.Entry = scene.Digest, local.Entry
	if r.given {
		return r.renderFrames(ctx, env, farm, show)
	}
	service := farm.Service()
	snapshot, err := service.Submit(ctx, r.request, "")
	if err != nil {
		return asUsage(err)
	}
	watch := &follower{
		source: service, id: snapshot.ID, reporter: show, interrupts: env.Interrupts, failed: farm.Failed(),
	}
	if snapshot, err = watch.follow(ctx); err != nil {
		return err
	}
	return r.fetch(ctx, service, snapshot)
}

// fetch writes what a job that is done has made.
func (r *renderFlags) fetch(ctx context.Context, service api.Service, snapshot job.Snapshot) error {
	image, err := service.Image(ctx, snapshot.ID)
	if err != nil {
		return err
	}
	report, err := service.SceneReport(ctx, snapshot.ID)
	if err != nil {
		return err
	}
	return r.write(image, snapshot, report)
}

func (r *renderFlags) write(image job.Image, snapshot job.Snapshot, report string) error {
	return writeOutputs(
		output{r.out, func(w io.Writer) error {
			return exr.Write(w, image, exr.Options{Half: r.half, Variance: true})
		}},
		output{r.png, func(w io.Writer) error { return preview.WritePNG(w, image, preview.Auto()) }},
		output{r.stats, func(w io.Writer) error { return writeStatistics(w, snapshot, report) }},
	)
}

// localScene asks the worker program which files a scene consists of.
func localScene(ctx context.Context, program, scene string, r *requestFlags) (bundle.Local, error) {
	absolute, err := filepath.Abs(scene)
	if err != nil {
		return bundle.Local{}, err
	}
	if info, err := os.Stat(absolute); err != nil || !info.Mode().IsRegular() {
		return bundle.Local{}, fmt.Errorf("%s: there is no such scene file", scene)
	}
	files, err := child.Files(ctx, program, absolute, r.sets, r.request.Lenient)
	if err != nil {
		return bundle.Local{}, err
	}
	if r.request.Name == "" {
		// Many scene files are called scene.xml; their folder tells them apart.
		r.request.Name = filepath.Join(filepath.Base(filepath.Dir(absolute)), filepath.Base(absolute))
	}
	return bundle.NewLocal(absolute, files)
}

// dataDir makes the given folder, or a temporary one that remove removes.
func dataDir(given string) (dir string, remove func(), err error) {
	if given != "" {
		return given, func() {}, os.MkdirAll(given, 0o750)
	}
	dir, err = os.MkdirTemp("", "metrofarm-")
	return dir, func() { os.RemoveAll(dir) }, err
}

// threadsPerWorker shares the machine out when the user does not say otherwise.
func threadsPerWorker(cpus, asked, workers int) int {
	if asked > 0 || workers == 0 {
		return asked
	}
	return max(1, cpus/workers)
}

func logger(w io.Writer, verbose bool) *slog.Logger {
	level := slog.LevelError
	if verbose {
		level = slog.LevelDebug
	}
	return slog.New(slog.NewTextHandler(w, &slog.HandlerOptions{Level: level}))
}
