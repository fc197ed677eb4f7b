package cli

import (
	"cmp"
	"context"
	"errors"
	"fmt"
	"io"
	"os"
	"strconv"
	"strings"
	"text/tabwriter"
	"time"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/client"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/tlsconf"
)

const (
	defaultServer  = "http://127.0.0.1:8080"
	serverVariable = "METROFARM_SERVER"
	tokenVariable  = "METROFARM_TOKEN"
)

// remoteFlags are what all commands share that speak to a server.
type remoteFlags struct {
	env                   Env
	server, ca, tokenFile string
	json                  bool
}

func (r *remoteFlags) register(f *flags) {
	r.env = f.env
	server := f.env.Getenv(serverVariable)
	if server == "" {
		server = defaultServer
	}
	f.StringVar(&r.server, "server", server, "`URL` of the coordinator; default: "+serverVariable+" or "+defaultServer)
	f.StringVar(&r.tokenFile, "token-file", "", "`FILE` with the token; default: the token in "+tokenVariable)
	f.StringVar(&r.ca, "ca", "", "trust servers that the authority of `FILE` has signed, and no others")
	f.BoolVar(&r.json, "json", false, "print JSON")
}

func (r *remoteFlags) connect() (*client.Client, error) {
	token, err := r.token()
	if err != nil {
		return nil, err
	}
	options := client.Options{Token: token}
	if r.ca != "" {
		if options.TLS, err = tlsconf.Client(r.ca); err != nil {
			return nil, fmt.Errorf("--ca: %w", err)
		}
	}
	c, err := client.New(r.server, options)
	if err != nil {
		return nil, usagef("--server: %v", err)
	}
	return c, nil
}

// token is never an argument: other users of this machine see those.
func (r *remoteFlags) token() (string, error) {
	if r.tokenFile == "" {
		return strings.TrimSpace(r.env.Getenv(tokenVariable)), nil
	}
	if err := auth.CheckPrivate(r.tokenFile); err != nil {
		return "", fmt.Errorf("--token-file: %w", err)
	}
	content, err := os.ReadFile(r.tokenFile)
	if err != nil {
		return "", fmt.Errorf("--token-file: %w", err)
	}
	token, _, _ := strings.Cut(strings.TrimSpace(string(content)), "\n") // metrofarm token writes a second line
	return strings.TrimSpace(token), nil
}

// remoteCommand parses the flags of a simple command and connects.
func remoteCommand(env Env, name string, arguments []string, low, high int, more func(*flags)) (remoteFlags, *client.Client, []string, error) {
	var r remoteFlags
	f := newFlags(name, env)
	r.register(f)
	if more != nil {
		more(f)
	}
	positional, err := f.parse(arguments, low, high)
	if err != nil {
		return r, nil, nil, err
	}
	c, err := r.connect()
	return r, c, positional, err
}

func listJobs(ctx context.Context, env Env, arguments []string) error {
	limit := 0
	r, c, _, err := remoteCommand(env, "jobs", arguments, 0, 0, func(f *flags) {
		f.IntVar(&limit, "limit", 20, "show at most `N` jobs; 0: all")
	})
	if err != nil {
		return ignoreHelp(err)
	}
	jobs, err := c.Jobs(ctx, limit)
	if err != nil {
		return err
	}
	if r.json {
		return writeJSON(env.Stdout, jobs)
	}
	return table(env.Stdout, "ID\tNAME\tUSER\tPRIORITY\tSTATE\tQUEUE\tDONE\tROUNDS\tRELMSE\tCREATED", func(w io.Writer) {
		for _, s := range jobs {
			fmt.Fprintf(w, "%s\t%s\t%s\t%d\t%s\t%s\t%d%%\t%d\t%s\t%s\n", s.ID, s.Request.Name, cmp.Or(s.User, "-"), s.Request.Priority,
				stateText(s), queueText(s), percent(s), s.RoundsDone, relMSEText(s), s.CreatedAt.Local().Format(time.DateTime))
		}
	})
}

func stateText(s job.Snapshot) string {
	if s.Paused && !s.State.Ended() {
		return string(s.State) + " (paused)"
	}
	return string(s.State)
}

// queueText is the place in the queue of a job that waits for workers.
func queueText(s job.Snapshot) string {
	if s.QueuePosition == 0 {
		return "-"
	}
	return strconv.Itoa(s.QueuePosition)
}

func relMSEText(s job.Snapshot) string {
	if s.RelMSE == nil {
		return "-"
	}
	return short(*s.RelMSE)
}

func table(w io.Writer, header string, rows func(io.Writer)) error {
	aligned := tabwriter.NewWriter(w, 0, 0, 2, ' ', 0)
	fmt.Fprintln(aligned, header)
	rows(aligned)
	return aligned.Flush()
}

func showJob(ctx context.Context, env Env, arguments []string) error {
	r, c, ids, err := remoteCommand(env, "job", arguments, 1, 1, nil)
	if err != nil {
		return ignoreHelp(err)
	}
	s, err := c.Job(ctx, ids[0])
	if err != nil {
		return err
	}
	if r.json {
		return writeJSON(env.Stdout, s)
	}
	fmt.Fprintf(env.Stdout, "%s  %s\n%s\n", s.ID, s.Request.Name, progressLine(s))
	if s.Sequence != nil {
		fmt.Fprintf(env.Stdout, "frame %d of sequence %s\n", s.Sequence.Frame, s.Sequence.ID)
	}
	fmt.Fprintln(env.Stdout, "priority:", s.Request.Priority)
	if s.QueuePosition > 0 {
		fmt.Fprintln(env.Stdout, "place in the queue:", s.QueuePosition)
	}
	if s.Error != "" {
		fmt.Fprintln(env.Stdout, "error:", s.Error)
	}
	if s.PauseReason != "" {
		fmt.Fprintln(env.Stdout, "paused:", s.PauseReason)
	}
	if s.StopReason != "" {
		fmt.Fprintln(env.Stdout, "stopped:", s.StopReason)
	}
	for _, warning := range s.Warnings {
		fmt.Fprintln(env.Stdout, "warning:", warning)
	}
	return nil
}

// act makes a command that does one thing to each job named.
func act(action string) func(context.Context, Env, []string) error {
	return func(ctx context.Context, env Env, arguments []string) error {
		r, c, ids, err := remoteCommand(env, action, arguments, 1, -1, nil)
		if err != nil {
			return ignoreHelp(err)
		}
		return r.toEach(ids, func(id string) (any, string, error) {
			if strings.HasPrefix(id, job.SequencePrefix) {
				if action == "finish" {
					return nil, "", usagef("finish: %s is a sequence; name its jobs, or cancel it", id)
				}
				q, err := c.ActOnSequence(ctx, id, action)
				return q, sequenceText(&q), err
			}
			s, err := c.Act(ctx, id, action)
			return s, stateText(s), err
		})
	}
}

// toEach does something to each job or sequence and prints what became of it, as JSON or in a line; one
// that fails does not keep it from the others.
func (r *remoteFlags) toEach(ids []string, do func(id string) (answer any, line string, err error)) error {
	var failures []error
	for _, id := range ids {
		answer, line, err := do(id)
		switch {
		case err != nil:
			failures = append(failures, err)
		case r.json:
			failures = append(failures, writeJSON(r.env.Stdout, answer))
		default:
			fmt.Fprintf(r.env.Stdout, "%s  %s\n", id, line)
		}
	}
	return errors.Join(failures...)
}

func changeJobs(ctx context.Context, env Env, arguments []string) error {
	patch := make(map[string]any)
	r, c, ids, err := remoteCommand(env, "change", arguments, 1, -1, func(f *flags) {
		f.Func("priority", "`N` from -100 to 100: jobs of higher priority go first", func(text string) error {
			n, err := strconv.Atoi(text)
			if err != nil {
				return errors.New("want a whole number")
			}
			patch["priority"] = n
			return nil
		})
		f.Func("name", "`TEXT` that people know the job by", func(text string) error {
			patch["name"] = text
			return nil
		})
	})
	switch {
	case err != nil:
		return ignoreHelp(err)
	case len(patch) == 0:
		return usagef("change: what? Give --priority or --name")
	}
	return r.toEach(ids, func(id string) (any, string, error) {
		s, err := c.Change(ctx, id, patch)
		return s, fmt.Sprintf("%s  priority %d  %s", stateText(s), s.Request.Priority, s.Request.Name), err
	})
}

func listWorkers(ctx context.Context, env Env, arguments []string) error {
	drain := ""
	r, c, _, err := remoteCommand(env, "workers", arguments, 0, 0, func(f *flags) {
		f.StringVar(&drain, "drain", "", "ask the worker `ID` to finish what it holds and leave")
	})
	if err != nil {
		return ignoreHelp(err)
	}
	if drain != "" {
		if _, err := c.Drain(ctx, drain); err != nil {
			return err
		}
	}
	workers, err := c.Workers(ctx)
	if err != nil {
		return err
	}
	if r.json {
		return writeJSON(env.Stdout, workers)
	}
	for _, k := range workers {
		if k.Exclusion != "" {
			defer fmt.Fprintf(env.Stdout, "%s is excluded: %s\n", k.Name, k.Exclusion)
		}
	}
	return table(env.Stdout, "ID\tNAME\tSTATE\tTHREADS\tSEGMENTS\tMUTATIONS/S\tLAST CONTACT\tVERSION", func(w io.Writer) {
		for _, k := range workers {
			fmt.Fprintf(w, "%s\t%s\t%s\t%d\t%d\t%s\t%s\t%s\n", k.ID, k.Name, k.State, k.Threads, k.LeasedSegments,
				metric(k.MutationsPerSecond), k.LastContact.Local().Format(time.DateTime), k.Version)
		}
	})
}
