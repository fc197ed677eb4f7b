// Package cli is the command line: it parses, calls a coordinator (in this process or over REST)
// and prints.
package cli

import (
	"context"
	"errors"
	"fmt"
	"io"
	"log/slog"
	"maps"
	"os"
	"slices"
	"strings"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/job"
)

// Exit codes.
const (
	exitOK      = 0
	exitFailure = 1
	exitUsage   = 2
)

// Farm is a coordinator in this process with its local workers.
type Farm interface {
	// Service runs jobs.
	Service() api.Service
	// AddScene stores a scene of this machine.
	AddScene(ctx context.Context, local bundle.Local) (bundle.Scene, error)
	// Dashboard is the address of the page, "" without one.
	Dashboard() string
	// Failed delivers errors that end the farm, such as a worker that will not start.
	Failed() <-chan error
	// Close ends workers and coordinator, after a checkpoint of what is under way.
	Close() error
}

// FarmOptions say what to start.
type FarmOptions struct {
	// DataDir holds everything durable.
	DataDir string
	// Listen is the address of REST and dashboard; "": none.
	Listen string
	// LocalOnly: nobody but this machine can reach Listen.
	LocalOnly bool
	// Store is "bolt", or the URL of a Redis server that several coordinators share.
	Store string
	// Advertise is the URL at which other coordinators reach Listen; "": the address of Listen.
	Advertise string
	// FarmListen is the address for workers.
	FarmListen string
	// Storage says where scenes and checkpoints go, how large scenes may be, and how long things stay.
	Storage Storage
	// Access says who may reach them, and how much they may ask for.
	Access Access
	// Flow bounds what workers send.
	Flow Flow
	// Workers to start here, each with so many Threads.
	Workers, Threads int
	// SceneMemory is what the scenes of each of them may take, in bytes; 0: the worker's default.
	SceneMemory int64
	// WorkerProgram is needed when Workers is not 0.
	WorkerProgram string
	// OneJob: the farm lives for one job. A worker that keeps dying at its start ends it (otherwise
	// it is tried forever), and at the end workers get no time to deliver what nobody waits for.
	OneJob bool
	// Version of this program.
	Version string
	Logger  *slog.Logger
}

// Env is what the commands need of the world.
type Env struct {
	Stdout, Stderr io.Writer
	// Terminal tells whether Stderr is one.
	Terminal bool
	Getenv   func(string) string
	Now      func() time.Time
	// Interrupts delivers Ctrl-C and SIGTERM.
	Interrupts <-chan os.Signal
	// Hangups starts to deliver SIGHUP, which otherwise ends the process.
	Hangups func() <-chan os.Signal
	// CPUs is the number of hardware threads.
	CPUs int
	// Memory that this process may use, in bytes; 0: not known.
	Memory int64
	// Version of this program.
	Version string
	// StartFarm starts a coordinator in this process.
	StartFarm func(context.Context, FarmOptions) (Farm, error)
}

type command struct {
	usage, summary string
	run            func(ctx context.Context, env Env, arguments []string) error
}

func commands() map[string]command {
	return map[string]command{
		"render":    {"SCENE -o OUT.exr [flags]", "render a scene on this machine", render},
		"inspect":   {"SCENE [flags]", "say what is in a scene, what it takes and what it warns of", inspect},
		"serve":     {"[flags]", "run a coordinator with REST interface and dashboard", serve},
		"submit":    {"SCENE|BUNDLE.zip [flags]", "send a scene to a coordinator", submit},
		"jobs":      {"[flags]", "list jobs", listJobs},
		"job":       {"ID [flags]", "show one job", showJob},
		"sequences": {"[flags]", "list sequences of frames", listSequences},
		"sequence":  {"ID [flags]", "show the frames of a sequence", showSequence},
		"change":    {"ID... [flags]", "change the priority or the name of jobs that have not ended", changeJobs},
		"cancel":    {"ID... [flags]", "end jobs, or whole sequences; their images so far stay", act("cancel")},
		"pause":     {"ID... [flags]", "stop handing out work of jobs, or of whole sequences", act("pause")},
		"resume":    {"ID... [flags]", "go on with paused jobs or sequences", act("resume")},
		"finish":    {"ID... [flags]", "make the round under way the last", act("finish")},
		"refine":    {"ID [flags]", "let a job that has ended go on, to a lower error or more samples", refine},
		"log":       {"ID [flags]", "show what happened to a job", showLog},
		"workers":   {"[flags]", "list workers", listWorkers},
		"token":     {"read|submit|admin USER", "make a token for metrofarm serve --tokens", makeToken},
		"certs":     {"DIR [flags]", "make certificates for trying TLS out", makeCertificates},
		"version":   {"", "print the version", printVersion},
	}
}

// Run runs one command line (without the program's name) and returns the exit code.
func Run(ctx context.Context, env Env, arguments []string) int {
	err := dispatch(ctx, env, arguments)
	var usage *usageError
	switch {
	case err == nil:
		return exitOK
	case errors.As(err, &usage):
		fmt.Fprintf(env.Stderr, "metrofarm: %v\n", oneLine(err))
		return exitUsage
	default:
		fmt.Fprintf(env.Stderr, "metrofarm: %v\n", oneLine(err))
		return exitFailure
	}
}

func dispatch(ctx context.Context, env Env, arguments []string) error {
	if len(arguments) == 0 {
		fmt.Fprint(env.Stderr, overview())
		return usagef("which command?")
	}
	name := arguments[0]
	if name == "help" || name == "--help" || name == "-h" {
		fmt.Fprint(env.Stdout, overview())
		return nil
	}
	chosen, found := commands()[name]
	if !found {
		return usagef("there is no command %q; metrofarm help lists them", name)
	}
	return chosen.run(ctx, env, arguments[1:])
}

func overview() string {
	var text strings.Builder
	text.WriteString("Metrofarm renders scenes with Metropolis light transport.\n\n")
	all := commands()
	for _, name := range slices.Sorted(maps.Keys(all)) {
		fmt.Fprintf(&text, "  metrofarm %-9s %-30s %s\n", name, all[name].usage, all[name].summary)
	}
	text.WriteString("\nmetrofarm COMMAND --help lists the flags of a command.\n")
	return text.String()
}

// usageError is a mistake on the command line.
type usageError struct{ message string }

func (e *usageError) Error() string { return e.message }

func usagef(format string, values ...any) error {
	return &usageError{fmt.Sprintf(format, values...)}
}

// asUsage turns a refused field of a request into the flag that set it.
func asUsage(err error) error {
	var field *job.FieldError
	if !errors.As(err, &field) {
		return err
	}
	if field.Field == "resolved" || field.Field == "job.resolved" {
		return usagef("--resolved: %s", field.Detail)
	}
	name := strings.TrimPrefix(field.Field, "job.") // of a sequence's job
	if name == "frames.start" || name == "frames.end" {
		return usagef("--%s: %s %s", framesFlag, strings.TrimPrefix(name, "frames."), field.Detail)
	}
	for _, option := range job.Options() {
		if option.Field == name {
			return usagef("--%s: %s", option.Flag, field.Detail)
		}
	}
	for _, option := range job.FrameOptions() {
		if option.Field == name {
			return usagef("--%s: %s", option.Flag, field.Detail)
		}
	}
	return usagef("%s", field.Error())
}

// oneLine keeps errors on one line: scripts read them by line.
func oneLine(err error) string {
	return strings.Join(strings.FieldsFunc(err.Error(), func(r rune) bool { return r == '\n' || r == '\r' }), "; ")
}

func printVersion(_ context.Context, env Env, arguments []string) error {
	if _, err := newFlags("version", env).parse(arguments, 0, 0); err != nil {
		return ignoreHelp(err)
	}
	_, err := fmt.Fprintf(env.Stdout, "metrofarm %s\n", env.Version)
	return err
}
