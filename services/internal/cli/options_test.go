package cli

import (
	"flag"
	"fmt"
	"os"
	"strings"
	"testing"

	"metrofarm/services/internal/job"
)

func TestHelpHasEveryOption(t *testing.T) {
	b := newBench(t, listsScene)
	if code := b.run(t, "render", "--help"); code != 0 {
		t.Fatal(b.stderr.String())
	}
	help := b.stdout.String()
	for _, option := range job.Options() {
		expectHelp(t, help, option)
	}
	for _, option := range job.FrameOptions() {
		expectHelp(t, help, option)
	}
}

func expectHelp[T any](t *testing.T, help string, option job.OptionOf[T]) {
	t.Helper()
	line := strings.TrimSpace("--" + option.Flag + " " + option.Takes())
	if !strings.Contains(help, "  "+line) || !strings.Contains(help, option.Help()) {
		t.Errorf("the help does not have %q with %q", line, option.Help())
	}
}

func TestFlagsReachTheRequest(t *testing.T) {
	var r requestFlags
	f := newFlags("render", newBench(t, listsScene).env)
	r.register(f)
	arguments := []string{
		"--integrator", "mmlt", "--delayed-rejection", "on", "--second-stage", "von-mises", "--concentration", "5",
		"--acceptance-rule", "tierney-mira", "--after-large-steps", "--technique-coordinate", "mutated",
		"--layer-weights", "kelemen", "--kernel", "uniform", "--half-width", "0.1", "--max-depth", "7",
		"--layers", "acceptance,techniques", "scene.xml",
	}
	if _, err := f.parse(arguments, 1, 1); err != nil {
		t.Fatal(err)
	}
	if err := r.finish(); err != nil {
		t.Fatal(err)
	}
	depth := 7
	want := job.Request{
		Integrator: "mmlt", DelayedRejection: "on", SecondStage: "von-mises", Concentration: 5, AcceptanceRule: "tierney-mira",
		AfterLargeSteps: true, TechniqueCoordinate: "mutated", LayerWeights: "kelemen", Kernel: "uniform", HalfWidth: 0.1,
		Layers: []string{"acceptance", "techniques"},
	}
	got := r.request
	if got.MaxDepth == nil || *got.MaxDepth != depth {
		t.Errorf("max depth %v", got.MaxDepth)
	}
	got.MaxDepth = nil
	if fmt.Sprintf("%+v", got) != fmt.Sprintf("%+v", want) {
		t.Errorf("request %+v, want %+v", got, want)
	}
}

// optionTable is a table of the README.
func optionTable[T any](options []job.OptionOf[T]) string {
	var table strings.Builder
	table.WriteString("| flag | field | meaning |\n| --- | --- | --- |\n")
	for _, option := range options {
		flag := strings.TrimSpace("--" + option.Flag + " " + strings.ReplaceAll(option.Takes(), "|", "\\|"))
		fmt.Fprintf(&table, "| `%s` | `%s` | %s |\n", flag, option.Field, strings.ReplaceAll(option.Help(), "<default>", "`<default>`"))
	}
	return table.String()
}

// serveTable is the table of what serve takes.
func serveTable(t *testing.T) string {
	t.Helper()
	var serve serveFlags
	f := newFlags("serve", newBench(t, listsScene).env)
	serve.register(f)
	var table strings.Builder
	table.WriteString("| flag | meaning |\n| --- | --- |\n")
	f.VisitAll(func(one *flag.Flag) {
		value, usage := flag.UnquoteUsage(one)
		name := strings.TrimSpace("--" + one.Name + " " + value)
		fmt.Fprintf(&table, "| `%s` | %s |\n", name, strings.TrimPrefix(usage, value+": "))
	})
	return table.String()
}

// TestReadmeHasTheOptions compares; METROFARM_UPDATE=1 writes the README's tables anew.
func TestReadmeHasTheOptions(t *testing.T) {
	compareReadme(t, "<!-- options: generated from services/internal/job -->\n", "<!-- end of options -->\n", optionTable(job.Options()))
	compareReadme(t, "<!-- frames: generated from services/internal/job -->\n", "<!-- end of frames -->\n", optionTable(job.FrameOptions()))
	compareReadme(t, "<!-- serve: generated from services/internal/cli -->\n", "<!-- end of serve -->\n", serveTable(t))
}

func compareReadme(t *testing.T, begin, end, table string) {
	t.Helper()
	const readme = "../../../README.md"
	content, err := os.ReadFile(readme)
	if err != nil {
		t.Fatal(err)
	}
	before, rest, found := strings.Cut(string(content), begin)
	old, after, closed := strings.Cut(rest, end)
	if !found || !closed {
		t.Fatalf("%s has no place for %s", readme, begin)
	}
	switch {
	case old == table:
	case os.Getenv("METROFARM_UPDATE") != "":
		err = os.WriteFile(readme, []byte(before+begin+table+end+after), 0o600)
	default:
		t.Errorf("the options in %s are not those of the program: run this test with METROFARM_UPDATE=1", readme)
	}
	if err != nil {
		t.Fatal(err)
	}
}
