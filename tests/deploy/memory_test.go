package deploy

import (
	"math"
	"net/http"
	"regexp"
	"slices"
	"strings"
	"testing"

	"github.com/prometheus/common/expfmt"
	"github.com/prometheus/common/model"
	corev1 "k8s.io/api/core/v1"
	"k8s.io/apimachinery/pkg/api/resource"
)

// container is what decides about the memory of one.
type container struct {
	limit     int64 // 0: none
	arguments []string
	goLimit   string // GOMEMLIMIT
}

// Programs keep to shares of their container's limit: the heap of a coordinator to nine tenths, films
// to half; the scenes of a worker to half, its films to a quarter. What says otherwise must fit.
func checkMemory(t *testing.T, coordinator, worker container) {
	t.Helper()
	for who, c := range map[string]container{"the coordinator": coordinator, "the worker": worker} {
		if c.limit < 1<<30 {
			t.Fatalf("%s has a limit of %d bytes; it would take what the machine has", who, c.limit)
		}
	}
	if coordinator.goLimit != "" {
		if got := size(t, strings.TrimSuffix(coordinator.goLimit, "B")); got > coordinator.limit/10*9 {
			t.Errorf("GOMEMLIMIT %s is more than nine tenths of %d bytes", coordinator.goLimit, coordinator.limit)
		}
	}
	atMost := func(c container, option, unit string, share int64) {
		t.Helper()
		for _, a := range c.arguments {
			if value, found := strings.CutPrefix(a, option+"="); found && size(t, value+unit) > c.limit/share {
				t.Errorf("%s is more than 1/%d of %d bytes", a, share, c.limit)
			}
		}
	}
	atMost(coordinator, "--films-memory", "", 2)
	atMost(coordinator, "--merge-budget", "", 8)
	atMost(worker, "--scene-memory", "", 2)
	// The coordinator is told what a worker has.
	told := slices.IndexFunc(coordinator.arguments, func(a string) bool { return strings.HasPrefix(a, "--max-worker-memory=") })
	if told < 0 {
		t.Fatal("the coordinator does not know how much memory workers have")
	}
	_, mebibytes, _ := strings.Cut(coordinator.arguments[told], "=")
	if got, want := size(t, mebibytes+"Mi"), worker.limit/4; got > want || got < want/2 {
		t.Errorf("films may take %d bytes in a worker; a quarter of its limit is %d", got, want)
	}
}

// size of "2048Mi", "8g", "1GiB" or "512".
func size(t *testing.T, text string) int64 {
	t.Helper()
	for _, unit := range []struct{ ours, theirs string }{{"iB", "i"}, {"g", "Gi"}, {"m", "Mi"}} { // Docker's are powers of 1024
		if rest, found := strings.CutSuffix(text, unit.ours); found {
			text = rest + unit.theirs
			break
		}
	}
	quantity, err := resource.ParseQuantity(text)
	if err != nil {
		t.Fatalf("%q: %v", text, err)
	}
	return quantity.Value()
}

var variable = regexp.MustCompile(`\$\{\w+:-([^}]*)\}`)

// inCompose is what decides about a service's memory with the defaults of all variables.
func (s service) inCompose(t *testing.T) container {
	t.Helper()
	c := container{goLimit: s.Environment["GOMEMLIMIT"]}
	if s.MemLimit != "" {
		c.limit = size(t, variable.ReplaceAllString(s.MemLimit, "$1"))
	}
	for _, a := range append(s.Entrypoint, s.Command...) {
		c.arguments = append(c.arguments, variable.ReplaceAllString(a, "$1"))
	}
	return c
}

func inPod(c corev1.Container) container {
	found := container{limit: c.Resources.Limits.Memory().Value(), arguments: c.Args}
	for _, e := range c.Env {
		if e.Name == "GOMEMLIMIT" {
			found.goLimit = e.Value
		}
	}
	return found
}

func TestLimitsOfMemoryFitTogether(t *testing.T) {
	services := readCompose(t).Services
	for _, coordinator := range []string{"coordinator-1", "coordinator-2"} {
		checkMemory(t, services[coordinator].inCompose(t), services["worker"].inCompose(t))
	}
	eachRelease(t, func(t *testing.T, r *release) {
		checkMemory(t, inPod(r.workload(t, releaseName+"-coordinator").template.Spec.Containers[0]),
			inPod(r.workload(t, releaseName+"-worker").template.Spec.Containers[0]))
	})
}

// What nobody sets is a share of what there is.
func TestCoordinatorsKeepToTheMemoryThatThereIs(t *testing.T) {
	gauges := gauges(t, startCoordinator(t))
	heap := gauges["go_gc_gomemlimit_bytes"]
	if heap == 0 || heap >= math.MaxInt64 {
		t.Fatalf("the heap is limited to %g bytes", heap)
	}
	memory := heap / 0.9
	if films := gauges["metrofarm_films_budget_bytes"]; math.Abs(films-memory/2) > memory/1000 {
		t.Errorf("films may take %g of %g bytes, want half", films, memory)
	}
	if batches := gauges["metrofarm_merge_budget_bytes"]; batches == 0 || batches > memory/7.9 {
		t.Errorf("batches may take %g of %g bytes, want an eighth at most", batches, memory)
	}
}

// gauges without labels that a coordinator serves.
func gauges(t *testing.T, address string) map[string]float64 {
	t.Helper()
	response, err := http.Get(address + "/metrics")
	if err != nil {
		t.Fatal(err)
	}
	defer response.Body.Close()
	parser := expfmt.NewTextParser(model.LegacyValidation)
	families, err := parser.TextToMetricFamilies(response.Body)
	if err != nil {
		t.Fatal(err)
	}
	values := map[string]float64{}
	for name, family := range families {
		if samples := family.GetMetric(); len(samples) == 1 && len(samples[0].GetLabel()) == 0 {
			values[name] = samples[0].GetGauge().GetValue()
		}
	}
	return values
}
