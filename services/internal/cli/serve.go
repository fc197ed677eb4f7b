package cli

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"net"
	"net/url"
	"os"
	"path/filepath"
	"strings"
	"sync"

	"metrofarm/services/internal/child"
	"metrofarm/services/internal/logging"
	"metrofarm/services/internal/store/redis"
)

// storeBolt is the name of the store in a file.
const storeBolt = "bolt"

// Formats of the log.
const (
	logText = "text"
	logJSON = "json"
)

type serveFlags struct {
	storageFlags
	accessFlags
	flowFlags
	listen, farmListen, data, store, advertise, logFormat string
	workers, threads                                      int
}

func (s *serveFlags) register(f *flags) {
	f.StringVar(&s.listen, "listen", "127.0.0.1:8080", "`ADDRESS` of the REST interface and the dashboard; default 127.0.0.1:8080")
	f.StringVar(&s.farmListen, "farm-listen", "127.0.0.1:7070", "`ADDRESS` that workers connect to; default 127.0.0.1:7070")
	f.StringVar(&s.data, "data", "metrofarm-data", "`DIR` for jobs, scenes and checkpoints; default metrofarm-data")
	f.StringVar(&s.store, "store", storeBolt, "`STORE` of jobs: bolt, a file in --data for one coordinator; redis://HOST:PORT/DB, "+
		"rediss://... (TLS) or unix:///SOCKET for several, which then share --blobs too; default bolt")
	f.StringVar(&s.advertise, "advertise", "", "`ADDRESS` or URL at which other coordinators reach this one's --listen; default: --listen")
	f.IntVar(&s.workers, "workers", 1, "`N` local worker processes; 0: only those that connect; default 1")
	f.IntVar(&s.threads, "threads", 0, "`N` render threads per local worker; default: all, shared out")
	f.StringVar(&s.logFormat, "log-format", logText, "`text|json`: how the log is written; json: one object per line, with the names of OpenTelemetry's log data model; default text")
	s.storageFlags.register(f)
	s.accessFlags.register(f)
	s.flowFlags.register(f)
}

func (s *serveFlags) check() error {
	switch {
	case s.store != storeBolt && !isURL(s.store):
		return usagef("--store: is %q; allowed: bolt, redis://HOST:PORT/DB, rediss://..., unix:///SOCKET", s.store)
	case s.logFormat != logText && s.logFormat != logJSON:
		return usagef("--log-format: is %q; allowed: text, json", s.logFormat)
	case s.workers < 0 || s.threads < 0:
		return usagef("--workers and --threads must not be negative")
	}
	return errors.Join(s.checkStore(), s.storageFlags.check(), s.accessFlags.check(s.listen, s.farmListen))
}

// checkStore looks at where the store and the other coordinators are.
func (s *serveFlags) checkStore() error {
	if s.advertise != "" {
		if scheme := "http://"; !isURL(s.advertise) {
			if s.tls.Certificate != "" {
				scheme = "https://"
			}
			s.advertise = scheme + s.advertise
		}
		u, err := url.Parse(s.advertise)
		if err != nil || u.Host == "" || strings.Trim(u.Path, "/") != "" || u.Scheme != "http" && u.Scheme != "https" {
			return usagef("--advertise: want HOST:PORT or http://HOST:PORT or https://HOST:PORT")
		}
		s.advertise = u.Scheme + "://" + u.Host
	}
	if s.store == storeBolt {
		return nil
	}
	if err := redis.Check(s.store); err != nil {
		return usagef("--store: %v", err)
	}
	host, _, _ := net.SplitHostPort(s.listen) // checked later
	if ip := net.ParseIP(host); s.advertise == "" && (host == "" || ip != nil && ip.IsUnspecified()) {
		return usagef("--listen %s is every address of this machine: say with --advertise at which one "+
			"other coordinators reach it", s.listen)
	}
	return nil
}

func isURL(text string) bool { return strings.Contains(text, "://") }

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
	if options.Access.Tokens != nil && options.Access.TLS == nil && !options.LocalOnly {
		options.Logger.Warn("tokens travel readable on " + s.listen + ": give --tls-cert and --tls-key, or put a proxy with TLS before it")
	}
	farm, err := env.StartFarm(ctx, options)
	if err != nil {
		return err
	}
	fmt.Fprintf(env.Stderr, "dashboard: %s\nworkers connect to %s\n", farm.Dashboard(), s.farmListen)
	watching, stop := context.WithCancel(ctx)
	var watch sync.WaitGroup
	watch.Go(func() { options.Access.watch(watching, env, options.Logger) })
	defer watch.Wait()
	defer stop()
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
	storage, err := s.storage(data, env.Getenv)
	if err != nil {
		return FarmOptions{}, err
	}
	access, err := s.open(data, env.Memory)
	if err != nil {
		return FarmOptions{}, err
	}
	local, err := isLocal(s.listen)
	if err != nil {
		return FarmOptions{}, err
	}
	s.flow.share(env.Memory, s.workers)
	options := FarmOptions{
		DataDir: data, Listen: s.listen, LocalOnly: local, FarmListen: s.farmListen, Access: access,
		Store: s.store, Advertise: s.advertise, Storage: storage, Flow: s.flow,
		Workers: s.workers, Threads: threadsPerWorker(env.CPUs, s.threads, s.workers), Version: env.Version,
		SceneMemory: sceneMemory(env.Memory, s.workers),
		Logger:      s.logger(env),
	}
	if s.workers > 0 {
		options.WorkerProgram, err = child.Locate(env.Getenv)
	}
	return options, err
}

func (s *serveFlags) logger(env Env) *slog.Logger {
	if s.logFormat == logJSON {
		return slog.New(logging.New(env.Stderr, "metrofarm", env.Version))
	}
	return slog.New(slog.NewTextHandler(env.Stderr, nil))
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
