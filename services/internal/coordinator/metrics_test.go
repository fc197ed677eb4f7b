package coordinator_test

import (
	"maps"
	"strings"
	"testing"

	"github.com/prometheus/client_golang/prometheus"
	dto "github.com/prometheus/client_model/go"

	"metrofarm/services/internal/coordinator"
	"metrofarm/services/internal/job"
)

// gather returns all values by "name{label=value}", those of histograms under _count and _sum.
func gather(t *testing.T, collector prometheus.Collector) map[string]float64 {
	t.Helper()
	registry := prometheus.NewPedanticRegistry()
	if err := registry.Register(collector); err != nil {
		t.Fatal(err)
	}
	families, err := registry.Gather()
	if err != nil {
		t.Fatal(err)
	}
	values := make(map[string]float64)
	for _, family := range families {
		for _, sample := range family.GetMetric() {
			maps.Copy(values, read(family.GetName(), sample))
		}
	}
	return values
}

func read(name string, sample *dto.Metric) map[string]float64 {
	var labels []string
	for _, l := range sample.GetLabel() {
		labels = append(labels, l.GetName()+"="+l.GetValue())
	}
	series := ""
	if len(labels) > 0 {
		series = "{" + strings.Join(labels, ",") + "}"
	}
	if h := sample.GetHistogram(); h != nil {
		return map[string]float64{name + "_count" + series: float64(h.GetSampleCount()), name + "_sum" + series: h.GetSampleSum()}
	}
	return map[string]float64{name + series: sample.GetCounter().GetValue() + sample.GetGauge().GetValue()}
}

func TestMetricsCountWhatAJobTook(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	defer s.crew(workers(2, nil)...)()
	ended := s.finished(s.submit(chainsRequest(60)))
	got := gather(t, s.c.Collector())
	if got["metrofarm_mutations_total"] < float64(ended.Mutations) {
		t.Errorf("%g mutations were counted, the job has %d", got["metrofarm_mutations_total"], ended.Mutations)
	}
	if got["metrofarm_proposals_total{kind=large}"]+got["metrofarm_proposals_total{kind=small}"] != got["metrofarm_mutations_total"] {
		t.Errorf("large and small proposals are not the mutations: %v", got)
	}
	if got["metrofarm_leases_granted_total"] < got["metrofarm_segments_total{outcome=committed}"] {
		t.Errorf("fewer leases than merged segments: %v", got)
	}
	for _, name := range []string{
		"metrofarm_segments_total{outcome=committed}", "metrofarm_batches_total{outcome=committed}",
		"metrofarm_delivered_bytes_total", "metrofarm_merge_seconds_count", "metrofarm_checkpoint_seconds_count",
		"metrofarm_checkpoint_bytes_total", "metrofarm_proposals_accepted_total{kind=small}",
	} {
		if got[name] <= 0 {
			t.Errorf("%s is %g", name, got[name])
		}
	}
	for _, name := range []string{
		"metrofarm_merge_queue_batches", "metrofarm_merge_queue_bytes", "metrofarm_held_bytes", "metrofarm_store_errors_total",
		"metrofarm_conflicts_total", "metrofarm_checkpoint_failures_total", "metrofarm_desired_workers",
	} {
		if value, served := got[name]; !served || value != 0 {
			t.Errorf("%s is %g (served: %v); want 0", name, value, served)
		}
	}
	for series := range got {
		if strings.Contains(series, ended.ID) {
			t.Errorf("%s names a job", series)
		}
	}
}

func TestMetricsTellWhatJobsCouldUse(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	first, second := s.submit(chainsRequest(60)), s.submit(pathRequest(30))
	checkDemand(t, s.c, 2, 2, 0)
	if _, err := s.c.Pause(t.Context(), first); err != nil {
		t.Fatal(err)
	}
	checkDemand(t, s.c, 1, 2, 1)
	if _, err := s.c.Cancel(t.Context(), second); err != nil {
		t.Fatal(err)
	}
	checkDemand(t, s.c, 0, 1, 1)
}

func checkDemand(t *testing.T, c *coordinator.Coordinator, desired, queued, paused float64) {
	t.Helper()
	got := gather(t, c.Collector())
	if got["metrofarm_desired_workers"] != desired || got["metrofarm_jobs{state="+string(job.Queued)+"}"] != queued || got["metrofarm_jobs_paused{state=queued}"] != paused {
		t.Errorf("%g workers wanted, %g jobs queued, %g paused; want %g, %g, %g", got["metrofarm_desired_workers"],
			got["metrofarm_jobs{state=queued}"], got["metrofarm_jobs_paused{state=queued}"], desired, queued, paused)
	}
}

// A paused job waits for nobody but its user, whatever its state: alerts go by these.
func TestMetricsTellPausedJobsApart(t *testing.T) {
	s := newSite(t)
	s.start()
	defer s.stop()
	rendered := s.submit(longRequest())
	dismiss := s.crew(workers(1, nil)...)
	s.await(rendered, "rendered", func(j job.Snapshot) bool { return j.State == job.Rendering })
	dismiss()
	queued := s.submit(chainsRequest(60))
	if waits := gather(t, s.c.Collector())["metrofarm_oldest_queued_job_seconds"]; waits <= 0 {
		t.Errorf("the oldest queued job waits for %g s", waits)
	}
	_, err := s.c.Pause(t.Context(), queued)
	s.check(err)
	got := gather(t, s.c.Collector())
	if waits := got["metrofarm_oldest_queued_job_seconds"]; waits != 0 {
		t.Errorf("a paused job waits for %g s", waits)
	}
	if got["metrofarm_jobs_paused{state=queued}"] != 1 || got["metrofarm_jobs_paused{state=rendering}"] != 0 {
		t.Errorf("the queued job is paused, not the one that is rendered: %v", got)
	}
	_, err = s.c.Pause(t.Context(), rendered)
	s.check(err)
	if got = gather(t, s.c.Collector()); got["metrofarm_jobs_paused{state=rendering}"] != 1 {
		t.Errorf("the one that is rendered is paused: %v", got)
	}
}
