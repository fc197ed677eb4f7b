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

// helpColumn is how wide the flags are in the help.
const helpColumn = 34

func (f *flags) help() {
	fmt.Fprintf(f.env.Stdout, "metrofarm %s %s: %s\n", f.name, commands()[f.name].usage, commands()[f.name].summary)
	f.VisitAll(func(one *flag.Flag) {
		value, usage := flag.UnquoteUsage(one)
		dashes := "--"
		if len(one.Name) == 1 {
			dashes = "-"
		}
		usage = strings.TrimPrefix(usage, value+": ")
		left := strings.TrimSpace(dashes + one.Name + " " + value)
		if len(left) > helpColumn {
			fmt.Fprintf(f.env.Stdout, "  %s\n", left)
			left = ""
		}
		fmt.Fprintf(f.env.Stdout, "  %-*s %s\n", helpColumn, left, usage)
	})
}

// ignoreHelp makes --help a success.
func ignoreHelp(err error) error {
	if errors.Is(err, flag.ErrHelp) {
		return nil
	}
	return err
}

// requestFlags are the flags that make up a job: one for each option, and --resolved.
type requestFlags struct {
	request      job.Request
	sets         []string
	resolvedPath string
}

func (r *requestFlags) register(f *flags) {
	for _, option := range job.Options() {
		registerOption(f, option, &r.request, r.set)
	}
	f.StringVar(&r.resolvedPath, "resolved", "", "repeat an image: `SPEC.json`, the resolved_spec of an earlier job")
}

// registerStop registers those that say when the job ends.
func (r *requestFlags) registerStop(f *flags) {
	for _, option := range job.StopOptions() {
		registerOption(f, option, &r.request, r.set)
	}
}

// registerOption makes a flag for an option of a document; set takes the pairs of a map.
func registerOption[T any](f *flags, option job.OptionOf[T], document *T, set func(string) error) {
	usage := option.Help()
	if takes := option.Takes(); takes != "" {
		usage = "`" + takes + "`: " + usage
	}
	switch field := option.In(document).(type) {
	case *string:
		f.StringVar(field, option.Flag, "", usage)
	case *float64:
		f.Float64Var(field, option.Flag, 0, usage)
	case *uint64:
		f.Uint64Var(field, option.Flag, 0, usage)
	case *int:
		f.IntVar(field, option.Flag, 0, usage)
	case *bool:
		f.BoolVar(field, option.Flag, false, usage)
	case **int:
		f.Func(option.Flag, usage, func(text string) error { return setValue(field, text, strconv.Atoi, "a whole number") })
	case **float64:
		f.Func(option.Flag, usage, func(text string) error { return setValue(field, text, parseFloat, "a number") })
	case *job.ShutterCurve:
		f.Func(option.Flag, usage, func(text string) error { *field = job.ShutterCurve(text); return nil })
	case *[]string:
		f.Func(option.Flag, usage, func(text string) error {
			*field = append(*field, strings.Split(text, ",")...)
			return nil
		})
	case *map[string]string:
		f.Func(option.Flag, usage, set)
	default:
		panic(fmt.Sprintf("option %s has a field of type %T", option.Field, field))
	}
}

func setValue[T any](field **T, text string, parse func(string) (T, error), kind string) error {
	value, err := parse(text)
	if err != nil {
		return errors.New("want " + kind)
	}
	*field = &value
	return nil
}

func parseFloat(text string) (float64, error) { return strconv.ParseFloat(text, 64) }

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
	if r.resolvedPath != "" {
		spec, err := os.ReadFile(r.resolvedPath)
		if err != nil {
			return fmt.Errorf("--resolved: %w", err)
		}
		r.request.Resolved = string(spec)
	}
	trial := withScene(r.request)
	return asUsage(trial.Validate())
}

// withScene is a request that can be checked before its scene is known.
func withScene(r job.Request) job.Request {
	r.Scene, r.Entry = strings.Repeat("0", 64), "scene.xml"
	return r
}
