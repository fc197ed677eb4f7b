package cli

import (
	"context"
	"fmt"
	"io"
	"maps"
	"slices"
	"strings"
	"text/tabwriter"

	"google.golang.org/protobuf/encoding/protojson"

	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/child"
)

// lightsShown keeps the picture of a scene with thousands of lights on one screen.
const lightsShown = 20

func inspect(ctx context.Context, env Env, arguments []string) error {
	var asJSON, lenient bool
	var r requestFlags
	f := newFlags("inspect", env)
	f.Func("set", "`NAME=VALUE` of a <default> of the scene; may be repeated", r.set)
	f.BoolVar(&lenient, "lenient", false, "warn about what is not known in the scene instead of refusing it")
	f.BoolVar(&asJSON, "json", false, "print JSON")
	positional, err := f.parse(arguments, 1, 1)
	if err != nil {
		return ignoreHelp(err)
	}
	program, err := child.Locate(env.Getenv)
	if err != nil {
		return err
	}
	text, err := child.Inspect(ctx, program, positional[0], r.sets, lenient)
	if err != nil {
		return err
	}
	if asJSON {
		_, err := env.Stdout.Write(text)
		return err
	}
	report := &scenev1.SceneReport{}
	if err := protojson.Unmarshal(text, report); err != nil {
		return fmt.Errorf("the worker's report: %w", err)
	}
	return printReport(env.Stdout, positional[0], report)
}

func printReport(w io.Writer, scene string, r *scenev1.SceneReport) error {
	fmt.Fprintln(w, scene)
	t := tabwriter.NewWriter(w, 0, 0, 2, ' ', 0)
	row := func(name, format string, values ...any) {
		if text := fmt.Sprintf(format, values...); text != "" {
			fmt.Fprintf(t, "  %s\t%s\n", name, text)
		}
	}
	row("image", "%d x %d, filter %s of radius %g", r.GetWidth(), r.GetHeight(), filterName(r.GetFilter()), r.GetFilterRadius())
	row("sensor", "%s", r.GetSensor())
	row("integrator", "%s, %d samples per pixel, depth %s", r.GetIntegrator(), r.GetSampleCount(), depthName(r.GetMaxDepth()))
	row("shapes", "%s", counts(r.GetShapes()))
	row("", "%d triangles, %d instances", r.GetTriangles(), r.GetInstances())
	row("materials", "%s", counts(r.GetBsdfs()))
	row("textures", "%s", counts(r.GetTextures()))
	row("lights", "%s", counts(r.GetEmitters()))
	m := r.GetMemory()
	row("memory", "%s: geometry %s, acceleration %s, images %s, lights %s", bytesText(r.GetMemoryBytes()),
		bytesText(m.GetGeometry()), bytesText(m.GetAcceleration()), bytesText(m.GetImages()), bytesText(m.GetLights()))
	row("time", "%.2f s to read, %.2f s to build", r.GetLoadSeconds(), r.GetBuildSeconds())
	if err := t.Flush(); err != nil {
		return err
	}
	return printPlaces(w, r)
}

// printPlaces lists what has a place in the scene's files.
func printPlaces(w io.Writer, r *scenev1.SceneReport) error {
	for i, light := range r.GetLights() {
		if i == lightsShown {
			fmt.Fprintf(w, "  ... and more lights; --json lists them\n")
			break
		}
		fmt.Fprintf(w, "  light    %s  %s\n", light.GetKind(), light.GetPlace())
	}
	for _, warning := range r.GetWarnings() {
		if _, err := fmt.Fprintf(w, "  warning  %s\n", warning); err != nil {
			return err
		}
	}
	return nil
}

func counts(of map[string]uint32) string {
	var parts []string
	for _, kind := range slices.Sorted(maps.Keys(of)) {
		parts = append(parts, fmt.Sprintf("%d %s", of[kind], kind))
	}
	return strings.Join(parts, ", ")
}

func filterName(filter scenev1.Filter) string {
	return strings.ToLower(strings.TrimPrefix(filter.String(), "FILTER_"))
}

func depthName(depth int32) string {
	if depth < 0 {
		return "unlimited"
	}
	return fmt.Sprint(depth)
}

func bytesText(n uint64) string {
	const mebi = 1 << 20
	if n < mebi {
		return fmt.Sprintf("%.1f KiB", float64(n)/1024)
	}
	return fmt.Sprintf("%.1f MiB", float64(n)/mebi)
}
