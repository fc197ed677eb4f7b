package deploy

import (
	"bufio"
	"context"
	"io"
	"net"
	"net/http"
	"os"
	"os/exec"
	"path/filepath"
	"strings"
	"sync"
	"syscall"
	"testing"
	"time"

	dto "github.com/prometheus/client_model/go"
	"github.com/prometheus/common/expfmt"
	"github.com/prometheus/common/model"
)

// metrics that are served: the values that were seen, by metric and label.
type metrics map[string]map[string]map[string]bool

var scraped struct {
	sync.Once
	served metrics
}

// program is the path of one of ours, made by make build.
func program(t *testing.T, name string) string {
	t.Helper()
	folder := os.Getenv("METROFARM_BIN")
	if folder == "" {
		folder = "../../bin"
	}
	path, err := filepath.Abs(filepath.Join(folder, name))
	if err != nil {
		t.Fatal(err)
	}
	return path
}

// scrape asks a real coordinator and a real worker what they serve.
func scrape(t *testing.T) metrics {
	t.Helper()
	scraped.Do(func() {
		served := metrics{}
		served.read(t, startCoordinator(t))
		served.read(t, startWorker(t))
		scraped.served = served
	})
	if scraped.served == nil {
		t.Fatal("nothing could be scraped")
	}
	return scraped.served
}

// startCoordinator returns its address; it ends with the test.
func startCoordinator(t *testing.T) string {
	t.Helper()
	ctx, kill := context.WithTimeout(context.Background(), time.Minute)
	command := exec.CommandContext(ctx, program(t, "metrofarm"), "serve", "--workers", "0", "--data", t.TempDir(),
		"--listen", "127.0.0.1:0", "--farm-listen", "127.0.0.1:0")
	log, err := command.StderrPipe()
	if err != nil {
		t.Fatal(err)
	}
	if err := command.Start(); err != nil {
		t.Fatalf("%v; make build makes it", err)
	}
	t.Cleanup(func() {
		_ = command.Process.Signal(syscall.SIGTERM)
		_ = command.Wait()
		kill()
	})
	lines := bufio.NewScanner(log)
	for lines.Scan() {
		if address, found := strings.CutPrefix(lines.Text(), "dashboard: "); found {
			go func() { _, _ = io.Copy(io.Discard, log) }() // ends with the program
			return strings.TrimSuffix(address, "/")
		}
	}
	t.Fatal("the coordinator did not say its address")
	return ""
}

// startWorker returns the address of its metrics. It finds no coordinator, which is no matter here.
func startWorker(t *testing.T) string {
	t.Helper()
	listener, err := net.Listen("tcp", "127.0.0.1:0")
	if err != nil {
		t.Fatal(err)
	}
	address := listener.Addr().String()
	if err := listener.Close(); err != nil {
		t.Fatal(err)
	}
	ctx, kill := context.WithTimeout(context.Background(), time.Minute)
	command := exec.CommandContext(ctx, program(t, "metrofarm-worker"), "--coordinator", "127.0.0.1:1",
		"--cache", t.TempDir(), "--metrics", address)
	if err := command.Start(); err != nil {
		t.Fatalf("%v; make build makes it", err)
	}
	t.Cleanup(func() {
		kill()
		_ = command.Wait()
	})
	for ctx.Err() == nil {
		if response, err := http.Get("http://" + address + "/healthz"); err == nil {
			_ = response.Body.Close()
			return "http://" + address
		}
		time.Sleep(50 * time.Millisecond)
	}
	t.Fatal("the worker serves no metrics")
	return ""
}

// read the metrics of a program.
func (m metrics) read(t *testing.T, address string) {
	t.Helper()
	for range 2 { // those of requests appear with the first
		response, err := http.Get(address + "/metrics")
		if err != nil {
			t.Fatal(err)
		}
		parser := expfmt.NewTextParser(model.LegacyValidation)
		families, err := parser.TextToMetricFamilies(response.Body)
		if err := response.Body.Close(); err != nil {
			t.Fatal(err)
		}
		if err != nil {
			t.Fatal(err)
		}
		for name, family := range families {
			if family.GetHelp() == "" {
				t.Errorf("%s has no help text", name)
			}
			m.add(name, family)
		}
	}
}

func (m metrics) add(name string, family *dto.MetricFamily) {
	names := []string{name}
	if family.GetType() == dto.MetricType_HISTOGRAM {
		names = []string{name + "_bucket", name + "_sum", name + "_count"}
	}
	for _, series := range names {
		if m[series] == nil {
			m[series] = map[string]map[string]bool{}
		}
		for _, sample := range family.GetMetric() {
			for _, label := range sample.GetLabel() {
				m.allow(series, label.GetName(), label.GetValue())
			}
		}
		if strings.HasSuffix(series, "_bucket") {
			m.allow(series, "le", "+Inf")
		}
	}
}

func (m metrics) allow(name, label, value string) {
	if m[name][label] == nil {
		m[name][label] = map[string]bool{}
	}
	m[name][label][value] = true
}
