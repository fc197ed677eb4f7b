// Command metrofarm renders scenes on this machine, runs a coordinator, and speaks to one.
package main

import (
	"context"
	"os"
	"os/signal"
	"runtime"
	"runtime/debug"
	"syscall"
	"time"

	"golang.org/x/term"

	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/localfarm"
)

const version = "0.1.0"

func main() {
	interrupts := make(chan os.Signal, 2)
	signal.Notify(interrupts, os.Interrupt, syscall.SIGTERM)
	memory := limitMemory()
	os.Exit(cli.Run(context.Background(), cli.Env{
		Stdout:     os.Stdout,
		Stderr:     os.Stderr,
		Terminal:   term.IsTerminal(int(os.Stderr.Fd())),
		Getenv:     os.Getenv,
		Now:        time.Now,
		Interrupts: interrupts,
		Hangups: func() <-chan os.Signal {
			hangups := make(chan os.Signal, 1)
			signal.Notify(hangups, syscall.SIGHUP)
			return hangups
		},
		CPUs:    runtime.NumCPU(),
		Memory:  memory,
		Version: version + revision(),
		StartFarm: func(ctx context.Context, options cli.FarmOptions) (cli.Farm, error) {
			return localfarm.Start(ctx, options)
		},
	}, os.Args[1:]))
}

// revision is the commit of the build, where the build knows it.
func revision() string {
	info, known := debug.ReadBuildInfo()
	if !known {
		return ""
	}
	for _, setting := range info.Settings {
		if setting.Key == "vcs.revision" {
			return " (" + setting.Value[:min(12, len(setting.Value))] + ")"
		}
	}
	return ""
}
