// Command farmload loads a coordinator with simulated workers: they speak the workers' protocol over
// gRPC and deliver films that a real worker made, but render nothing. It serves the load test in
// tests/load and is not part of what users install.
package main

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"io"
	"os"
	"os/signal"
	"syscall"
)

const usage = `usage: farmload record|run|limits [flags]; -h shows a command's flags
  record   stand between a worker and a coordinator and keep the films that it delivers
  run      work as many workers do and print what it took, as JSON
  limits   print how fast this machine copies memory and unpacks and merges such films, as JSON`

func main() {
	ctx, stop := signal.NotifyContext(context.Background(), os.Interrupt, syscall.SIGTERM)
	defer stop()
	if err := command(ctx, os.Args[1:], os.Stdout); err != nil {
		fmt.Fprintln(os.Stderr, "farmload:", err)
		os.Exit(1)
	}
}

func command(ctx context.Context, arguments []string, out io.Writer) error {
	if len(arguments) == 0 {
		return errors.New(usage)
	}
	commands := map[string]func(context.Context, []string) (any, error){
		"record": record, "run": run, "limits": limits,
	}
	chosen := commands[arguments[0]]
	if chosen == nil {
		return fmt.Errorf("no command %q\n%s", arguments[0], usage)
	}
	result, err := chosen(ctx, arguments[1:])
	if err != nil {
		return fmt.Errorf("%s: %w", arguments[0], err)
	}
	encoder := json.NewEncoder(out)
	encoder.SetIndent("", "  ")
	return encoder.Encode(result)
}
