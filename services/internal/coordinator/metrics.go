package coordinator

import (
	"github.com/prometheus/client_golang/prometheus"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/job"
)

// metrics of one coordinator. No series carries a job's identity: jobs come and go.
type metrics struct {
	c                 *Coordinator
	segments          *prometheus.CounterVec
	expired           prometheus.Counter
	mutations         prometheus.Counter
	rays              prometheus.Counter
	trapped           prometheus.Counter
	mergeSeconds      prometheus.Histogram
	checkpointSeconds prometheus.Histogram

	jobs, workers, checkpointAge, waiting *prometheus.Desc
}

func newMetrics(c *Coordinator) *metrics {
	counter := func(name, help string) prometheus.Counter {
		return prometheus.NewCounter(prometheus.CounterOpts{Name: name, Help: help})
	}
	histogram := func(name, help string) prometheus.Histogram {
		return prometheus.NewHistogram(prometheus.HistogramOpts{
			Name: name, Help: help, Buckets: prometheus.ExponentialBuckets(0.001, 2, 14),
		})
	}
	desc := func(name, help string, labels ...string) *prometheus.Desc {
		return prometheus.NewDesc(name, help, labels, nil)
	}
	return &metrics{
		c: c,
		segments: prometheus.NewCounterVec(prometheus.CounterOpts{
			Name: "metrofarm_segments_total", Help: "Delivered segments by outcome of their batch.",
		}, []string{"outcome"}),
		expired:           counter("metrofarm_leases_expired_total", "Leases that ran out without result."),
		mutations:         counter("metrofarm_mutations_total", "Merged mutations and path samples."),
		rays:              counter("metrofarm_rays_total", "Rays of merged segments."),
		trapped:           counter("metrofarm_trapped_chains_total", "Stays of chains, in merged segments, that reached 2000 mutations."),
		mergeSeconds:      histogram("metrofarm_merge_seconds", "Time from the last tile of a batch to its merge."),
		checkpointSeconds: histogram("metrofarm_checkpoint_seconds", "Time to write a checkpoint."),
		jobs:              desc("metrofarm_jobs", "Jobs by state.", "state"),
		workers:           desc("metrofarm_workers", "Workers by state.", "state"),
		checkpointAge:     desc("metrofarm_checkpoint_age_seconds", "Age of the oldest running job's last checkpoint."),
		waiting:           desc("metrofarm_open_tasks", "Tasks that are waiting or leased."),
	}
}

var outcomeNames = map[farmv1.Outcome]string{
	farmv1.Outcome_OUTCOME_COMMITTED:  "committed",
	farmv1.Outcome_OUTCOME_DUPLICATE:  "duplicate",
	farmv1.Outcome_OUTCOME_SUPERSEDED: "superseded",
	farmv1.Outcome_OUTCOME_CONFLICT:   "conflict",
	farmv1.Outcome_OUTCOME_REJECTED:   "rejected",
}

func (m *metrics) countBatch(outcome farmv1.Outcome, segments int) {
	m.segments.WithLabelValues(outcomeNames[outcome]).Add(float64(segments))
}

// Collector exports the coordinator's metrics; all names begin with metrofarm_.
func (c *Coordinator) Collector() prometheus.Collector { return c.metrics }

func (m *metrics) parts() []prometheus.Collector {
	return []prometheus.Collector{m.segments, m.expired, m.mutations, m.rays, m.trapped, m.mergeSeconds, m.checkpointSeconds}
}

// Describe implements prometheus.Collector.
func (m *metrics) Describe(out chan<- *prometheus.Desc) {
	for _, part := range m.parts() {
		part.Describe(out)
	}
	for _, d := range []*prometheus.Desc{m.jobs, m.workers, m.checkpointAge, m.waiting} {
		out <- d
	}
}

// Collect implements prometheus.Collector.
func (m *metrics) Collect(out chan<- prometheus.Metric) {
	for _, part := range m.parts() {
		part.Collect(out)
	}
	gauge := func(d *prometheus.Desc, v float64, labels ...string) {
		out <- prometheus.MustNewConstMetric(d, prometheus.GaugeValue, v, labels...)
	}
	states := map[job.State]int{}
	open, age := 0, 0.0
	for _, r := range m.c.runs() {
		r.mu.Lock()
		states[r.rec.State]++
		open += r.table.Open()
		if r.rec.State == job.Rendering && !r.lastCheckpoint.IsZero() {
			age = max(age, m.c.options.Now().Sub(r.lastCheckpoint).Seconds())
		}
		r.mu.Unlock()
	}
	for _, s := range []job.State{job.Queued, job.Inspecting, job.Bootstrapping, job.Rendering, job.Done, job.Failed, job.Canceled} {
		gauge(m.jobs, float64(states[s]), string(s))
	}
	gauge(m.waiting, float64(open))
	gauge(m.checkpointAge, age)
	m.collectWorkers(gauge)
}

func (m *metrics) collectWorkers(gauge func(*prometheus.Desc, float64, ...string)) {
	held := m.c.heldByWorker()
	counts := map[string]int{"idle": 0, "busy": 0, "draining": 0, "lost": 0}
	m.c.mu.Lock()
	defer m.c.mu.Unlock()
	for _, w := range m.c.workers {
		counts[m.c.workerView(w, held[w.id]).State]++
	}
	for state, n := range counts {
		gauge(m.workers, float64(n), state)
	}
}
