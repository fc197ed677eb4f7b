package cli

import (
	"context"
	"errors"
	"fmt"
	"io"
	"text/tabwriter"
	"time"

	"metrofarm/services/internal/client"
	"metrofarm/services/internal/job"
)

const (
	defaultServer  = "http://127.0.0.1:8080"
	serverVariable = "METROFARM_SERVER"
)

// remoteFlags are what all commands share that speak to a server.
type remoteFlags struct {
	server string
	json   bool
}

func (r *remoteFlags) register(f *flags) {
	server := f.env.Getenv(serverVariable)
	if server == "" {
		server = defaultServer
	}
	f.StringVar(&r.server, "server", server, "`URL` of the coordinator; default: "+serverVariable+" or "+defaultServer)
	f.BoolVar(&r.json, "json", false, "print JSON")
}

func (r *remoteFlags) connect() (*client.Client, error) {
	c, err := client.New(r.server)
	if err != nil {
		return nil, usagef("--server: %v", err)
	}
	return c, nil
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
	return table(env.Stdout, "ID\tNAME\tSTATE\tDONE\tROUNDS\tRELMSE\tCREATED", func(w io.Writer) {
		for _, s := range jobs {
			fmt.Fprintf(w, "%s\t%s\t%s\t%d%%\t%d\t%s\t%s\n", s.ID, s.Request.Name, stateText(s), percent(s),
				s.RoundsDone, relMSEText(s), s.CreatedAt.Local().Format(time.DateTime))
		}
	})
}

func stateText(s job.Snapshot) string {
	if s.Paused && !s.State.Ended() {
		return string(s.State) + " (paused)"
	}
	return string(s.State)
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
		var failures []error
		for _, id := range ids {
			s, err := c.Act(ctx, id, action)
			switch {
			case err != nil:
				failures = append(failures, err)
			case r.json:
				failures = append(failures, writeJSON(env.Stdout, s))
			default:
				fmt.Fprintf(env.Stdout, "%s  %s\n", s.ID, stateText(s))
			}
		}
		return errors.Join(failures...)
	}
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
