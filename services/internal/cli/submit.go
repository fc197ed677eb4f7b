package cli

import (
	"context"
	"crypto/rand"
	"errors"
	"fmt"
	"io"
	"os"
	"slices"
	"strings"

	"metrofarm/services/internal/blob"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/child"
	"metrofarm/services/internal/client"
	"metrofarm/services/internal/job"
)

// resultFlags say what to do about a job that was started.
type resultFlags struct {
	remoteFlags
	out        string
	half, wait bool
}

func (r *resultFlags) register(f *flags) {
	r.remoteFlags.register(f)
	f.StringVar(&r.out, "o", "", "wait, then write the image to `OUT.exr`")
	f.BoolVar(&r.half, "half", false, "store 16-bit floats")
	f.BoolVar(&r.wait, "wait", false, "wait until the job has ended")
}

type submitFlags struct {
	requestFlags
	frameFlags
	resultFlags
	entry, key string
}

func (s *submitFlags) register(f *flags) {
	s.requestFlags.register(f)
	s.frameFlags.register(f)
	s.resultFlags.register(f)
	f.IntVar(&s.request.Priority, "priority", 0, "`N` from -100 to 100: jobs of higher priority go first; default 0")
	f.BoolVar(&s.request.InspectOnly, "inspect-only", false, "have a worker look at the scene; render nothing")
	f.StringVar(&s.entry, "entry", "", "`PATH` of the scene file in a bundle that has several")
	f.StringVar(&s.key, "idempotency-key", "", "`KEY` that makes repeating this command safe")
}

func submit(ctx context.Context, env Env, arguments []string) error {
	var s submitFlags
	f := newFlags("submit", env)
	s.register(f)
	positional, err := f.parse(arguments, 1, 1)
	if err != nil {
		return ignoreHelp(err)
	}
	if err := errors.Join(checkOutputs(s.out), s.finish(), s.check(s.request, s.out)); err != nil {
		return err
	}
	if s.request.InspectOnly && s.out != "" {
		return usagef("submit: --inspect-only makes no image for -o")
	}
	c, err := s.connect()
	if err != nil {
		return err
	}
	if s.request.Scene, s.request.Entry, err = s.upload(ctx, env, c, positional[0]); err != nil {
		return err
	}
	if s.given {
		return s.submitFrames(ctx, env, c)
	}
	if s.key == "" {
		s.key = rand.Text() // so that a repeat inside the HTTP client is no second job
	}
	snapshot, err := c.Submit(ctx, s.request, s.key)
	if err != nil {
		return err
	}
	return s.show(ctx, env, c, snapshot)
}

// show waits for a job if that is asked for, and prints what it is.
func (s *resultFlags) show(ctx context.Context, env Env, c *client.Client, snapshot job.Snapshot) error {
	if !s.wait && s.out == "" {
		return s.print(env, snapshot)
	}
	fmt.Fprintf(env.Stderr, "job %s\n", snapshot.ID)
	return s.await(ctx, env, c, snapshot.ID)
}

func (s *resultFlags) print(env Env, snapshot job.Snapshot) error {
	if s.json {
		return writeJSON(env.Stdout, snapshot)
	}
	_, err := fmt.Fprintln(env.Stdout, snapshot.ID)
	return err
}

func (s *resultFlags) await(ctx context.Context, env Env, c *client.Client, id string) error {
	watch := &follower{
		source: c, id: id, interrupts: env.Interrupts,
		reporter: &reporter{w: env.Stderr, terminal: env.Terminal},
	}
	snapshot, err := watch.follow(ctx)
	if err != nil {
		return err
	}
	if err := s.download(ctx, c, id, s.out); err != nil {
		return err
	}
	return s.print(env, snapshot)
}

// download writes a job's image to a file; "": nowhere.
func (s *resultFlags) download(ctx context.Context, c *client.Client, id, path string) error {
	image := "image.exr?precision=float"
	if s.half {
		image = "image.exr?precision=half"
	}
	return writeOutputs(output{path, func(w io.Writer) error { return c.Download(ctx, id, image, w) }})
}

// upload sends a bundle, or the files of a scene, and returns the bundle's digest and the entry.
func (s *submitFlags) upload(ctx context.Context, env Env, c *client.Client, path string) (digest, entry string, err error) {
	if bundle.IsScene(path) {
		return s.uploadScene(ctx, env, c, path)
	}
	file, err := os.Open(path)
	if err != nil {
		return "", "", err
	}
	defer file.Close()
	scene, err := c.Upload(ctx, file)
	if err != nil {
		return "", "", fmt.Errorf("%s: %w", path, err)
	}
	entry, err = chooseEntry(scene, s.entry)
	if err != nil {
		return "", "", fmt.Errorf("%s: %w", path, err)
	}
	return scene.Digest, entry, nil
}

func (s *submitFlags) uploadScene(ctx context.Context, env Env, c *client.Client, path string) (digest, entry string, err error) {
	program, err := child.Locate(env.Getenv)
	if err != nil {
		return "", "", err
	}
	local, err := localScene(ctx, program, path, &s.requestFlags)
	if err != nil {
		return "", "", err
	}
	reader, writer := io.Pipe()
	go func() { writer.CloseWithError(local.WriteTar(writer)) }() // ends when the reader is closed
	defer reader.Close()
	scene, err := c.Upload(ctx, reader)
	if err != nil {
		return "", "", fmt.Errorf("%s: %w", path, err)
	}
	return scene.Digest, local.Entry, nil
}

// chooseEntry picks the scene file: the one asked for, or the only one nearest to the root.
func chooseEntry(scene bundle.Scene, asked string) (string, error) {
	if asked != "" {
		if !slices.ContainsFunc(scene.Files, func(file blob.File) bool { return file.Path == asked }) {
			return "", usagef("--entry: there is no %s in the bundle", asked)
		}
		return asked, nil
	}
	depth := func(path string) int { return strings.Count(path, "/") }
	switch {
	case len(scene.Entries) == 0:
		return "", errors.New("there is no .xml file in the bundle")
	case len(scene.Entries) > 1 && depth(scene.Entries[0]) == depth(scene.Entries[1]):
		return "", usagef("the bundle has several scene files (%s); choose with --entry",
			strings.Join(scene.Entries, ", "))
	}
	return scene.Entries[0], nil
}
