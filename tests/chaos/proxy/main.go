// Command proxy stands between workers and coordinators and disturbs what workers deliver: seeded,
// and with a journal of what it did and what the coordinators answered. It is for tests.
package main

import (
	"context"
	"flag"
	"fmt"
	"log/slog"
	"net"
	"os"
	"os/signal"
	"strings"
	"syscall"

	"google.golang.org/grpc"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// stringsFlag is an option that may be repeated.
type stringsFlag []string

func (s *stringsFlag) String() string { return strings.Join(*s, ",") }

func (s *stringsFlag) Set(value string) error {
	*s = append(*s, value)
	return nil
}

func main() {
	if err := run(); err != nil {
		slog.Error("proxy failed", "error", err)
		os.Exit(1)
	}
}

func run() error {
	var routes stringsFlag
	flag.Var(&routes, "route", "`LISTEN=UPSTREAM`, a coordinator and where workers find it; may be repeated")
	seed := flag.Uint64("seed", 1, "of the schedule")
	rate := flag.Float64("rate", 0.5, "share of deliveries that are disturbed; of reports it is half of that")
	kinds := flag.String("faults", strings.Join(faultNames(), ","), "which ones, with commas")
	forge := flag.String("forge", "", "`ROUND/SEGMENT` that the first worker to deliver it gets wrong, digests and all")
	path := flag.String("journal", "journal.jsonl", "`FILE` of what was done")
	flag.Parse()

	book, err := openJournal(*path)
	if err != nil {
		return err
	}
	schedule, err := newSchedule(*seed, *rate, *kinds)
	if err != nil {
		return err
	}
	target, err := parseForgery(*forge)
	if err != nil {
		return err
	}
	ctx, stop := signal.NotifyContext(context.Background(), os.Interrupt, syscall.SIGTERM)
	defer stop()
	d := newDisturber(ctx, schedule, target, book)
	for _, route := range routes {
		if err := d.serve(ctx, route); err != nil {
			return err
		}
	}
	<-ctx.Done()
	return nil
}

// serve starts to pass on what workers send to one coordinator.
func (d *disturber) serve(ctx context.Context, route string) error {
	listen, upstream, found := strings.Cut(route, "=")
	if !found {
		return fmt.Errorf("--route %q: should be LISTEN=UPSTREAM", route)
	}
	connection, err := dial(upstream)
	if err != nil {
		return fmt.Errorf("--route %q: %w", route, err)
	}
	listener, err := (&net.ListenConfig{}).Listen(ctx, "tcp", listen)
	if err != nil {
		return fmt.Errorf("--route %q: %w", route, err)
	}
	server := grpc.NewServer(serverOptions()...)
	farmv1.RegisterFarmServiceServer(server, newPassage(d, upstream, farmv1.NewFarmServiceClient(connection)))
	go func() {
		<-ctx.Done()
		server.Stop()
	}()
	go func() {
		if err := server.Serve(listener); err != nil {
			slog.Error("a route ended", "route", route, "error", err)
		}
	}()
	return nil
}
