package cli

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"net"
	"os"
	"path/filepath"
	"strings"

	"metrofarm/services/internal/child"
)

type serveFlags struct {
	listen, farmListen, data, store string
	workers, threads                int
	insecure                        bool
}

func (s *serveFlags) register(f *flags) {
	f.StringVar(&s.listen, "listen", "127.0.0.1:8080", "`ADDRESS` of the REST interface and the dashboard")
	f.StringVar(&s.farmListen, "farm-listen", "127.0.0.1:7070", "`ADDRESS` that workers connect to")
	f.StringVar(&s.data, "data", "metrofarm-data", "`DIR` for jobs, scenes and checkpoints")
	f.StringVar(&s.store, "store", "bolt", "`bolt`: a file in --data; redis://... will follow")
	f.IntVar(&s.workers, "workers", 1, "`N` local worker processes; 0: only those that connect")
	f.IntVar(&s.threads, "threads", 0, "`N` render threads per local worker; default: all, shared out")
	f.BoolVar(&s.insecure, "insecure", false, "allow addresses that other machines reach, without access control")
}

func (s *serveFlags) check() error {
	switch {
	case strings.HasPrefix(s.store, "redis"):
		return usagef("--store %s is not available yet; use bolt", s.store)
	case s.store != "bolt":
		return usagef("--store: is %q; allowed: bolt", s.store)
	case s.workers < 0 || s.threads < 0:
		return usagef("--workers and --threads must not be negative")
	}
	if err := checkListen(s.listen, s.insecure); err != nil {
		return err
	}
	return checkListen(s.farmListen, s.insecure)
}

// checkListen refuses addresses that other machines can reach: there is no access control yet.
func checkListen(address string, insecure bool) error {
	host, _, err := net.SplitHostPort(address)
	if err != nil {
		return usagef("address %q: want HOST:PORT", address)
	}
	if insecure || isLoopback(host) {
		return nil
	}
	return usagef("%s can be reached by other machines and there is no access control yet; "+
		"use 127.0.0.1, or --insecure on a network that you trust", address)
}

func isLoopback(host string) bool {
	ip := net.ParseIP(host)
	return host == "localhost" || (ip != nil && ip.IsLoopback())
}

func serve(ctx context.Context, env Env, arguments []string) error {
	var s serveFlags
	f := newFlags("serve", env)
	s.register(f)
	if _, err := f.parse(arguments, 0, 0); err != nil {
		return ignoreHelp(err)
	}
	if err := s.check(); err != nil {
		return err
	}
	options, err := s.farmOptions(env)
	if err != nil {
		return err
	}
	farm, err := env.StartFarm(ctx, options)
	if err != nil {
		return err
	}
	fmt.Fprintf(env.Stderr, "dashboard: %s\nworkers connect to %s\n", farm.Dashboard(), s.farmListen)
	return errors.Join(waitForEnd(ctx, env, farm), closeUnlessInterrupted(env, farm))
}

func (s *serveFlags) farmOptions(env Env) (FarmOptions, error) {
	data, err := filepath.Abs(s.data)
	if err != nil {
		return FarmOptions{}, err
	}
	if err := os.MkdirAll(data, 0o750); err != nil {
		return FarmOptions{}, err
	}
	host, _, _ := net.SplitHostPort(s.listen) // checked before
	options := FarmOptions{
		DataDir: data, Listen: s.listen, LocalOnly: isLoopback(host), FarmListen: s.farmListen,
		Workers: s.workers, Threads: threadsPerWorker(env.CPUs, s.threads, s.workers), Version: env.Version,
		Logger: slog.New(slog.NewTextHandler(env.Stderr, nil)),
	}
	if s.workers > 0 {
		options.WorkerProgram, err = child.Locate(env.Getenv)
	}
	return options, err
}

func waitForEnd(ctx context.Context, env Env, farm Farm) error {
	select {
	case <-ctx.Done():
		return ctx.Err()
	case err := <-farm.Failed():
		return err
	case <-env.Interrupts:
		fmt.Fprintln(env.Stderr, "stopping; interrupt again to stop at once")
		return nil
	}
}

// closeUnlessInterrupted writes checkpoints and stops; a second interrupt leaves that to the next
// start, which renders again what is missing.
func closeUnlessInterrupted(env Env, farm Farm) error {
	closed := make(chan error, 1)
	go func() { closed <- farm.Close() }() // ends with the process at the latest
	select {
	case err := <-closed:
		return err
	case <-env.Interrupts:
		return errAborted
	}
}
