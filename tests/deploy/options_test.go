package deploy

import (
	"os/exec"
	"regexp"
	"strings"
	"testing"
)

// help is what a program says of its options.
func help(t *testing.T, name string, arguments ...string) string {
	t.Helper()
	output, err := exec.Command(program(t, name), arguments...).CombinedOutput()
	if err != nil {
		t.Fatalf("%s %v: %v\n%s", name, arguments, err, output)
	}
	return string(output)
}

// checkOptions wants a program to have the options that it is started with.
func checkOptions(t *testing.T, who, known string, words []string) {
	t.Helper()
	for _, word := range words {
		option, _, _ := strings.Cut(word, "=")
		if strings.HasPrefix(option, "--") && !regexp.MustCompile(`(^|[\s\[,])`+regexp.QuoteMeta(option)+`\b`).MatchString(known) {
			t.Errorf("%s is started with %s, which it does not have", who, option)
		}
	}
}

func TestProgramsHaveTheOptionsTheyAreStartedWith(t *testing.T) {
	coordinator, worker := help(t, "metrofarm", "serve", "--help"), help(t, "metrofarm-worker", "--help")
	for name, s := range readCompose(t).Services {
		switch {
		case strings.HasPrefix(name, "coordinator"):
			checkOptions(t, name, coordinator, append(s.Entrypoint, s.Command...))
		case name == "worker":
			checkOptions(t, name, worker, s.Command)
		}
	}
	eachRelease(t, func(t *testing.T, r *release) {
		checkOptions(t, "the coordinator", coordinator, r.workload(t, releaseName+"-coordinator").template.Spec.Containers[0].Args)
		checkOptions(t, "the worker", worker, r.workload(t, releaseName+"-worker").template.Spec.Containers[0].Args)
	})
}
