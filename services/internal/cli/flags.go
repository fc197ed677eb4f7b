package cli

import (
	"errors"
	"flag"
	"fmt"
	"io"
	"os"
	"strconv"
	"strings"

	"metrofarm/services/internal/job"
)

// flags is a FlagSet whose flags may stand before, between and after the other arguments.
type flags struct {
	*flag.FlagSet
	env  Env
	name string
}

func newFlags(name string, env Env) *flags {
	set := flag.NewFlagSet(name, flag.ContinueOnError)
	set.SetOutput(io.Discard)
	set.Usage = func() {}
	return &flags{set, env, name}
}

// parse returns the arguments that are no flags; there must be at least low and at most high (-1: any
// number) of them.
func (f *flags) parse(arguments []string, low, high int) ([]string, error) {
	var positional []string
	for len(arguments) > 0 {
		if err := f.Parse(arguments); err != nil {
			if errors.Is(err, flag.ErrHelp) {
				f.help()
				return nil, err
			}
			return nil, usagef("%s: %v", f.name, err)
		}
		rest := f.Args()
		used := len(arguments) - len(rest)
		if used > 0 && arguments[used-1] == "--" {
			positional = append(positional, rest...)
			break
		}
		if len(rest) > 0 {
			positional = append(positional, rest[0])
			rest = rest[1:]
		}
		arguments = rest
	}
	switch {
	case len(positional) < low:
		return nil, usagef("%s: usage: metrofarm %s %s", f.name, f.name, commands()[f.name].usage)
	case high >= 0 && len(positional) > high:
		return nil, usagef("%s: what is %q for? Usage: metrofarm %s %s", f.name, positional[high],
			f.name, commands()[f.name].usage)
	}
	return positional, nil
}

func (f *flags) help() {
	fmt.Fprintf(f.env.Stdout, "metrofarm %s %s: %s\n", f.name, commands()[f.name].usage, commands()[f.name].summary)
	f.VisitAll(func(one *flag.Flag) {
		value, usage := flag.UnquoteUsage(one)
		dashes := "--"
		if len(one.Name) == 1 {
			dashes = "-"
		}
		fmt.Fprintf(f.env.Stdout, "  %-34s %s\n", strings.TrimSpace(dashes+one.Name+" "+value), usage)
	})
}

// ignoreHelp makes --help a success.
func ignoreHelp(err error) error {
	if errors.Is(err, flag.ErrHelp) {
		return nil
	}
	return err
}

// requestFlags are the flags that make up a job.
type requestFlags struct {
	request      job.Request
	sets         []string
	under        string
	delayed      string
	resolvedPath string
}

func (r *requestFlags) register(f *flags) {
	q := &r.request
	f.StringVar(&q.Name, "name", "", "name of the job, `NAME`; default: the scene file's, with its folder")
	f.StringVar(&q.Integrator, "integrator", job.IntegratorAuto, "what produces the samples, `auto|path|pssmlt`; bdpt and mmlt will follow")
	f.StringVar(&r.under, "under", "path", "what chains run over, `path`; bdpt will follow")
	f.StringVar(&r.delayed, "delayed-rejection", "auto", "second stage after a rejected small step, `auto|off`; on will follow")
	f.StringVar(&q.LightSampling, "light-sampling", "", "how emitters are found, `mis|emitter|bsdf`; default mis")
	f.Uint64Var(&q.Stop.SamplesPerPixel, "spp", 0, "stop after `N` samples per pixel (path)")
	f.Uint64Var(&q.Stop.MutationsPerPixel, "mutations-per-pixel", 0, "stop after `N` mutations per pixel (pssmlt)")
	f.Float64Var(&q.Stop.TimeSeconds, "time", 0, "stop after `SECONDS` of rendering, at the end of a round")
	f.Float64Var(&q.Stop.TargetError, "target-error", 0, "stop when the relative MSE is below `RELMSE`")
	f.IntVar(&q.Stop.Rounds, "rounds", 0, "stop after exactly `N` rounds")
	f.Func("max-depth", "longest path in edges, `N`; -1: no limit", r.setMaxDepth)
	f.Uint64Var(&q.Seed, "seed", 0, "number `N`: another seed, another noise")
	f.IntVar(&q.Width, "width", 0, "image width in `PIXELS`; default: the scene's")
	f.IntVar(&q.Height, "height", 0, "image height in `PIXELS`; default: the scene's")
	f.Func("set", "`NAME=VALUE` of a <default> of the scene; may be repeated", r.set)
	f.BoolVar(&q.Lenient, "lenient", false, "warn about what is not known in the scene instead of refusing it")
	f.StringVar(&q.Kernel, "kernel", "", "law of small steps, `kelemen|gaussian` (pssmlt)")
	f.Float64Var(&q.Sigma, "sigma", 0, "standard deviation `S` of the gaussian kernel")
	f.Float64Var(&q.LargeStepProbability, "large-step-probability", 0, "`P` of a large step (pssmlt)")
	f.Uint64Var(&q.Chains, "chains", 0, "at least `N` chains (pssmlt)")
	f.Uint64Var(&q.BootstrapSamples, "bootstrap", 0, "at least `N` independent samples first")
	f.StringVar(&r.resolvedPath, "resolved", "", "repeat an image: `SPEC.json`, the resolved_spec of an earlier job")
}

func (r *requestFlags) setMaxDepth(text string) error {
	depth, err := strconv.Atoi(text)
	if err != nil {
		return errors.New("want a whole number")
	}
	r.request.MaxDepth = &depth
	return nil
}

func (r *requestFlags) set(text string) error {
	name, value, found := strings.Cut(text, "=")
	if !found || name == "" {
		return errors.New("want NAME=VALUE")
	}
	if r.request.Defaults == nil {
		r.request.Defaults = make(map[string]string)
	}
	r.request.Defaults[name] = value
	r.sets = append(r.sets, text)
	return nil
}

// finish checks what was parsed, before anything is started, and reads the file of --resolved.
func (r *requestFlags) finish() error {
	notYet := func(name, value, instead string) error {
		return usagef("--%s %s is not available yet; use %s", name, value, instead)
	}
	switch {
	case r.request.Integrator == "bdpt" || r.request.Integrator == "mmlt":
		return notYet("integrator", r.request.Integrator, "auto, path or pssmlt")
	case r.under == "bdpt":
		return notYet("under", r.under, "path")
	case r.under != "path":
		return usagef("--under: is %q; allowed: path", r.under)
	case r.delayed == "on":
		return notYet("delayed-rejection", r.delayed, "auto or off")
	case r.delayed != "auto" && r.delayed != "off":
		return usagef("--delayed-rejection: is %q; allowed: auto, off", r.delayed)
	}
	if r.resolvedPath != "" {
		spec, err := os.ReadFile(r.resolvedPath)
		if err != nil {
			return fmt.Errorf("--resolved: %w", err)
		}
		r.request.Resolved = string(spec)
	}
	trial := r.request
	trial.Scene, trial.Entry = strings.Repeat("0", 64), "scene.xml" // not known yet
	return asUsage(trial.Validate())
}
