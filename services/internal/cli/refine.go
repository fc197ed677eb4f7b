package cli

import (
	"context"
	"errors"
)

func refine(ctx context.Context, env Env, arguments []string) error {
	var stop requestFlags
	var s resultFlags
	f := newFlags("refine", env)
	stop.registerStop(f)
	s.register(f)
	positional, err := f.parse(arguments, 1, 1)
	if err != nil {
		return ignoreHelp(err)
	}
	if err := errors.Join(checkOutputs(s.out), stop.finish()); err != nil {
		return err
	}
	c, err := s.connect()
	if err != nil {
		return err
	}
	snapshot, err := c.Refine(ctx, positional[0], stop.request.Stop)
	if err != nil {
		return err
	}
	return s.show(ctx, env, c, snapshot)
}

func showLog(ctx context.Context, env Env, arguments []string) error {
	after := uint64(0)
	r, c, ids, err := remoteCommand(env, "log", arguments, 1, 1, func(f *flags) {
		f.Uint64Var(&after, "after", 0, "show what follows record `N`; default 0: all that is kept")
	})
	if err != nil {
		return ignoreHelp(err)
	}
	format := "text"
	if r.json {
		format = "json"
	}
	return c.Log(ctx, ids[0], after, format, env.Stdout)
}
