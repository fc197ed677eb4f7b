package cli

import (
	"context"
	"crypto/tls"
	"errors"
	"fmt"
	"log/slog"
	"net"
	"path/filepath"
	"strings"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/plan"
	"metrofarm/services/internal/reload"
	"metrofarm/services/internal/tlsconf"
)

// Access says who may reach a farm, by which means, and how much they may ask of it. The zero value
// lets everybody do everything that the default limits of the interface allow.
type Access struct {
	// Tokens that requests must bring; nil: none. SessionKey and SessionTime are for the sessions of
	// browsers.
	Tokens      *auth.Tokens
	SessionKey  []byte
	SessionTime time.Duration
	// OpenMetrics serves /metrics without a token.
	OpenMetrics bool
	// Hosts are names that requests may call the server by, beside localhost.
	Hosts []string
	// TLS of the REST interface and of the workers' port; nil: none.
	TLS, FarmTLS *tlsconf.Server
	// PeerTLS trusts the REST interfaces of other coordinators; nil: as this machine does.
	PeerTLS *tls.Config
	// Limits on clients; the zero value means the defaults. JobLimits on each job.
	Limits    api.Limits
	JobLimits plan.Limits
	// MaxJobs is how many jobs may be there that have not ended, MaxUserJobs how many of one user; 0: no
	// bound.
	MaxJobs, MaxUserJobs int
}

// Defaults of the limits on jobs, where memory allows: an 8K image by chains in a worker, a 4K one with direct light
// apart in the coordinator.
const (
	defaultPixels       = 1 << 25
	defaultChains       = 1 << 17
	defaultPerPixel     = 1 << 20
	defaultMemoryMiB    = 16 << 10
	maxDefaultWorkerMiB = 8 << 10
	defaultJobs         = 20000
	defaultSessionTime  = 12 * time.Hour
	mebibyte            = 1 << 20
	maxMiB              = 1 << 40
	// reloadEvery so often files of tokens and certificates are looked at.
	reloadEvery = 2 * time.Second
)

// accessFlags of serve.
type accessFlags struct {
	Access
	tokens, sessionKey      string
	peerCA                  string
	tls, farmTLS            tlsconf.Files
	memoryMiB, workerMemory uint64
	insecure                bool
}

func (a *accessFlags) register(f *flags) {
	f.StringVar(&a.tokens, "tokens", "", "ask for the tokens of `FILE` (metrofarm token makes them)")
	f.StringVar(&a.sessionKey, "session-key", "", "`FILE` of the key that signs browsers' sessions; coordinators behind one name share it; default: session.key in --data")
	f.DurationVar(&a.SessionTime, "session-time", defaultSessionTime, "`TIME` after which a browser asks for the token again; default 12h")
	f.BoolVar(&a.OpenMetrics, "open-metrics", false, "serve /metrics without a token")
	f.Func("host", "`NAME` that browsers may call this server by, beside localhost; may be repeated", func(name string) error {
		a.Hosts = append(a.Hosts, name)
		return nil
	})
	f.StringVar(&a.tls.Certificate, "tls-cert", "", "`FILE` with the certificate of the REST interface, which then speaks https")
	f.StringVar(&a.tls.Key, "tls-key", "", "`FILE` with its key")
	f.StringVar(&a.farmTLS.Certificate, "farm-tls-cert", "", "`FILE` with the certificate that workers see")
	f.StringVar(&a.farmTLS.Key, "farm-tls-key", "", "`FILE` with its key")
	f.StringVar(&a.farmTLS.ClientCA, "farm-tls-ca", "", "`FILE` with the authority that signs the workers' certificates")
	f.StringVar(&a.peerCA, "peer-ca", "", "`FILE` with the authority that signs the --tls-cert of other coordinators; default: those that this machine trusts")
	f.BoolVar(&a.insecure, "insecure", false, "listen on addresses that other machines reach without tokens or TLS")
	a.registerLimits(f)
}

func (a *accessFlags) registerLimits(f *flags) {
	a.Limits = api.DefaultLimits()
	l := &a.Limits
	f.Float64Var(&l.RequestsPerSecond, "max-rate", l.RequestsPerSecond, "`N` requests per second of one token or address in the long run; default 100")
	f.IntVar(&l.Burst, "max-burst", l.Burst, "`N` requests of one token or address at once; default 400")
	f.IntVar(&l.Uploads, "max-uploads", l.Uploads, "`N` uploads at a time; default 8")
	f.IntVar(&l.Streams, "max-streams", l.Streams, "`N` event streams at a time; default 1024")
	f.IntVar(&l.StreamsPerClient, "max-client-streams", l.StreamsPerClient, "`N` event streams of one token or address; default 256")
	f.Int64Var(&l.BodyBytes, "max-body", l.BodyBytes, "`BYTES` of a JSON document; default 4194304")
	f.IntVar(&a.MaxJobs, "max-jobs", defaultJobs, "`N` jobs of all users that have not ended, frames of sequences too; default 20000")
	f.IntVar(&a.MaxUserJobs, "max-user-jobs", 0, "`N` jobs of one user likewise; default 0: as many as --max-jobs")
	j := &a.JobLimits
	f.Uint64Var(&j.Pixels, "max-pixels", defaultPixels, "`N` pixels of an image; default 33554432, 8K")
	f.Uint64Var(&j.Chains, "max-chains", defaultChains, "`N` chains of a job; default 131072")
	f.Uint64Var(&j.PerPixel, "max-per-pixel", defaultPerPixel, "`N` samples or mutations per pixel of a job; default 1048576")
	f.Uint64Var(&a.memoryMiB, "max-memory", defaultMemoryMiB, "`MIB` of a job's film and chains in the coordinator, as estimated; at most --films-memory; default 16384")
	f.Uint64Var(&a.workerMemory, "max-worker-memory", 0, "`MIB` likewise in each worker, beside its scenes; default a quarter of the memory "+
		"that this server has, as if workers had as much; at most 8192")
}

// check refuses what makes no sense, before anything is started.
func (a *accessFlags) check(listen, farmListen string) error {
	if err := a.checkNumbers(); err != nil {
		return err
	}
	farm := a.farmTLS
	switch {
	case (a.tls.Certificate == "") != (a.tls.Key == ""):
		return usagef("--tls-cert and --tls-key belong together")
	case (farm.Certificate == "") != (farm.Key == "") || (farm.Key == "") != (farm.ClientCA == ""):
		return usagef("--farm-tls-cert, --farm-tls-key and --farm-tls-ca belong together")
	}
	return a.checkReach(listen, farmListen)
}

func (a *accessFlags) checkNumbers() error {
	l := a.Limits
	switch {
	case !(l.RequestsPerSecond > 0) || l.Burst < 1:
		return usagef("--max-rate and --max-burst must be positive")
	case l.Uploads < 1 || l.Streams < 1 || l.StreamsPerClient < 1 || l.BodyBytes < 1:
		return usagef("--max-uploads, --max-streams, --max-client-streams and --max-body must be positive")
	case a.MaxJobs < 1 || a.MaxUserJobs < 0:
		return usagef("--max-jobs must be positive, and --max-user-jobs must not be negative")
	case a.memoryMiB > maxMiB || a.workerMemory > maxMiB:
		return usagef("--max-memory and --max-worker-memory are at most %d MiB", uint64(maxMiB))
	case a.SessionTime < time.Second:
		return usagef("--session-time is %s; want at least 1s", a.SessionTime)
	}
	return nil
}

// checkReach refuses addresses that other machines can reach where reaching them is all it takes to
// use them.
func (a *accessFlags) checkReach(listen, farmListen string) error {
	local, err := isLocal(listen)
	if err != nil {
		return err
	}
	farmLocal, err := isLocal(farmListen)
	if err != nil {
		return err
	}
	var missing []string
	if !local && a.tokens == "" {
		missing = append(missing, "--listen "+listen+" can be reached by other machines and needs --tokens (metrofarm token makes them)")
	}
	if !farmLocal && a.farmTLS.ClientCA == "" {
		missing = append(missing, "--farm-listen "+farmListen+
			" can be reached by other machines and needs --farm-tls-cert, --farm-tls-key and --farm-tls-ca (metrofarm certs makes them)")
	}
	if a.insecure || len(missing) == 0 {
		return nil
	}
	return usagef("%s; or use 127.0.0.1, or --insecure on a network that you trust", strings.Join(missing, "; "))
}

// isLocal tells whether only this machine reaches an address.
func isLocal(address string) (bool, error) {
	host, _, err := net.SplitHostPort(address)
	if err != nil {
		return false, usagef("address %q: want HOST:PORT", address)
	}
	ip := net.ParseIP(host)
	return host == "localhost" || (ip != nil && ip.IsLoopback()), nil
}

// limitWorkers fills in what films may take in a worker: a quarter of its memory, of which scenes have
// half.
func (a *accessFlags) limitWorkers(memory int64) {
	if a.workerMemory > 0 {
		return
	}
	a.workerMemory = maxDefaultWorkerMiB
	if memory > 0 {
		a.workerMemory = min(a.workerMemory, max(1, uint64(memory)/4/mebibyte))
	}
}

// open reads the files that the flags name. dataDir exists; memory is what the process may use.
func (a *accessFlags) open(dataDir string, memory int64) (Access, error) {
	a.limitWorkers(memory)
	a.JobLimits.CoordinatorBytes, a.JobLimits.WorkerBytes = a.memoryMiB*mebibyte, a.workerMemory*mebibyte
	var err error
	if a.tokens != "" {
		if a.Tokens, err = auth.OpenTokens(a.tokens); err != nil {
			return Access{}, fmt.Errorf("--tokens: %w", err)
		}
		if a.sessionKey == "" {
			a.sessionKey = filepath.Join(dataDir, "session.key")
		}
		if a.SessionKey, err = auth.SessionKey(a.sessionKey); err != nil {
			return Access{}, fmt.Errorf("--session-key: %w", err)
		}
	}
	if a.TLS, err = openTLS(a.tls); err != nil {
		return Access{}, fmt.Errorf("--tls-cert: %w", err)
	}
	if a.FarmTLS, err = openTLS(a.farmTLS); err != nil {
		return Access{}, fmt.Errorf("--farm-tls-cert: %w", err)
	}
	if a.peerCA != "" {
		if a.PeerTLS, err = tlsconf.Client(a.peerCA); err != nil {
			return Access{}, fmt.Errorf("--peer-ca: %w", err)
		}
	}
	return a.Access, nil
}

func openTLS(files tlsconf.Files) (*tlsconf.Server, error) {
	if files.Certificate == "" {
		return nil, nil
	}
	return tlsconf.Open(files)
}

// watch reads the files again when they change or when the process gets SIGHUP, until ctx ends.
func (a *Access) watch(ctx context.Context, env Env, logger *slog.Logger) {
	watcher := reload.Watcher{Every: reloadEvery, Now: env.Hangups(), Logger: logger}
	if a.Tokens != nil {
		watcher.Sources = append(watcher.Sources, reload.Source{Name: "tokens", Files: []string{a.Tokens.Path()}, Reload: a.Tokens.Reload})
	}
	for name, server := range map[string]*tlsconf.Server{"TLS of REST": a.TLS, "TLS of workers": a.FarmTLS} {
		if server != nil {
			watcher.Sources = append(watcher.Sources, reload.Source{Name: name, Files: server.Files(), Reload: server.Reload})
		}
	}
	watcher.Run(ctx)
}

func makeToken(_ context.Context, env Env, arguments []string) error {
	words, err := newFlags("token", env).parse(arguments, 2, 2)
	if err != nil {
		return ignoreHelp(err)
	}
	role, err := auth.ParseRole(words[0])
	if err != nil {
		return usagef("token: %v", err)
	}
	token, line, err := auth.NewToken(role, words[1])
	if err != nil {
		return usagef("token: %v", err)
	}
	fmt.Fprintln(env.Stderr, "first the token, which is told only now, then the line for the file of metrofarm serve --tokens:")
	_, err = fmt.Fprintf(env.Stdout, "%s\n%s\n", token, line)
	return err
}

func makeCertificates(_ context.Context, env Env, arguments []string) error {
	hosts := []string{"localhost", "127.0.0.1", "::1"}
	f := newFlags("certs", env)
	f.Func("host", "`NAME` or address that the server is reached by, beside localhost; may be repeated", func(name string) error {
		if name == "" {
			return errors.New("is empty")
		}
		hosts = append(hosts, name)
		return nil
	})
	words, err := f.parse(arguments, 1, 1)
	if err != nil {
		return ignoreHelp(err)
	}
	if err := tlsconf.Generate(words[0], hosts, env.Now()); err != nil {
		return fmt.Errorf("certs: %w", err)
	}
	file := func(name string) string { return filepath.Join(words[0], name) }
	_, err = fmt.Fprintf(env.Stdout, "For trying out; they last a year.\n"+
		"metrofarm serve --tls-cert %[1]s --tls-key %[2]s --farm-tls-cert %[1]s --farm-tls-key %[2]s --farm-tls-ca %[3]s\n"+
		"metrofarm jobs --server https://%[6]s:8080 --ca %[3]s\n"+
		"metrofarm-worker --coordinator %[6]s:7070 --tls-ca %[3]s --tls-cert %[4]s --tls-key %[5]s\n",
		file("server.crt"), file("server.key"), file("ca.crt"), file("worker.crt"), file("worker.key"), hosts[len(hosts)-1])
	return err
}
