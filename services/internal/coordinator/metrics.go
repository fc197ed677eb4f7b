package coordinator

import (
	"io"

	"github.com/prometheus/client_golang/prometheus"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/merge"
	"metrofarm/services/internal/tally"
)

// metrics of one coordinator; sums over coordinators are those of the farm. No series carries a
// job's identity: jobs come and go. What is a state and not an event is in gauges.go.
type metrics struct {
	segments, batches                *prometheus.CounterVec
	deliveredBytes                   prometheus.Counter
	mergeSeconds                     prometheus.Histogram
	queueBatches                     prometheus.Gauge
	granted, expired                 prometheus.Counter
	released, withheld               prometheus.Counter
	mutations, rays                  prometheus.Counter
	evaluations                      prometheus.Counter
	cpuSeconds                       prometheus.Counter
	proposed, accepted               *prometheus.CounterVec
	trapped                          prometheus.Counter
	anomalies                        *prometheus.CounterVec
	checkpointSeconds                prometheus.Histogram
	checkpointBytes                  prometheus.Counter
	checkpointFailures               prometheus.Counter
	conflicts, excluded, quarantines prometheus.Counter
	storeErrors                      prometheus.Counter
	taken, lost                      prometheus.Counter

	gauges gauges
	parts  []prometheus.Collector
}

func newMetrics(c *Coordinator) *metrics {
	m := &metrics{gauges: newGauges(c)}
	m.addDeliveries()
	m.addLeases()
	m.addRendering()
	m.addKeeping()
	return m
}

func (m *metrics) counter(name, help string) prometheus.Counter {
	return add(m, prometheus.NewCounter(prometheus.CounterOpts{Name: name, Help: help}))
}

func (m *metrics) counters(name, help, label string) *prometheus.CounterVec {
	return add(m, prometheus.NewCounterVec(prometheus.CounterOpts{Name: name, Help: help}, []string{label}))
}

func (m *metrics) gauge(name, help string) prometheus.Gauge {
	return add(m, prometheus.NewGauge(prometheus.GaugeOpts{Name: name, Help: help}))
}

func (m *metrics) histogram(name, help string) prometheus.Histogram {
	return add(m, prometheus.NewHistogram(prometheus.HistogramOpts{
		Name: name, Help: help, Buckets: prometheus.ExponentialBuckets(0.001, 2, 14),
	}))
}

func add[T prometheus.Collector](m *metrics, part T) T {
	m.parts = append(m.parts, part)
	return part
}

func (m *metrics) addDeliveries() {
	m.segments = m.counters("metrofarm_segments_total", "Delivered segments by outcome of their batch.", "outcome")
	m.batches = m.counters("metrofarm_batches_total", "Delivered batches by the reply to them.", "outcome")
	m.deliveredBytes = m.counter("metrofarm_delivered_bytes_total", "Bytes of the tiles that workers delivered, packed.")
	m.mergeSeconds = m.histogram("metrofarm_merge_seconds", "Time from the last tile of a batch to its merge.")
	m.queueBatches = m.gauge("metrofarm_merge_queue_batches", "Batches that are being delivered and are not answered.")
	for _, outcome := range outcomeNames { // from the start, so that rates have something to begin with
		m.segments.WithLabelValues(outcome)
		m.batches.WithLabelValues(outcome)
	}
}

func (m *metrics) addLeases() {
	m.granted = m.counter("metrofarm_leases_granted_total", "Leases granted to workers.")
	m.expired = m.counter("metrofarm_leases_expired_total", "Leases that ran out without result.")
	m.released = m.counter("metrofarm_leases_released_total", "Leases given back unfinished, without blame.")
	m.withheld = m.counter("metrofarm_leases_withheld_total", "Lease calls that found segments waiting and got none because the merge queue was over its budget.")
}

func (m *metrics) addRendering() {
	m.mutations = m.counter("metrofarm_mutations_total", "Merged mutations and path samples.")
	m.rays = m.counter("metrofarm_rays_total", "Rays of merged segments.")
	m.evaluations = m.counter("metrofarm_path_evaluations_total", "Path evaluations of merged segments.")
	m.cpuSeconds = m.counter("metrofarm_render_cpu_seconds_total", "CPU time that workers report for merged batches.")
	m.proposed = m.counters("metrofarm_proposals_total", "Proposals of chains in merged segments.", "kind")
	m.accepted = m.counters("metrofarm_proposals_accepted_total", "Those that were accepted.", "kind")
	m.trapped = m.counter("metrofarm_trapped_chains_total", "Stays of chains, in merged segments, that reached 2000 mutations.")
	m.anomalies = m.counters("metrofarm_anomalies_total", "Contributions of merged segments that were zeroed.", "kind")
	for _, kind := range tally.AnomalyNames() {
		m.anomalies.WithLabelValues(kind)
	}
	m.countProposals(&tally.Counts{})
}

func (m *metrics) addKeeping() {
	m.checkpointSeconds = m.histogram("metrofarm_checkpoint_seconds", "Time to write a checkpoint.")
	m.checkpointBytes = m.counter("metrofarm_checkpoint_bytes_total", "Bytes of checkpoints that were written.")
	m.checkpointFailures = m.counter("metrofarm_checkpoint_failures_total", "Checkpoints that could not be written.")
	m.conflicts = m.counter("metrofarm_conflicts_total", "Times that a worker was flagged for a batch or report that cannot be right.")
	m.quarantines = m.counter("metrofarm_quarantines_total", "Times that a worker got no leases for a while: what it sent was damaged.")
	m.excluded = m.counter("metrofarm_workers_excluded_total", "Workers that were found to render wrong and get no more work.")
	m.taken = m.counter("metrofarm_jobs_taken_over_total", "Jobs without owner that this coordinator acquired.")
	m.lost = m.counter("metrofarm_jobs_lost_total", "Jobs that another coordinator acquired from this one.")
	m.storeErrors = m.counter("metrofarm_store_errors_total", "Operations on the store that failed.")
}

var outcomeNames = map[farmv1.Outcome]string{
	farmv1.Outcome_OUTCOME_COMMITTED:  "committed",
	farmv1.Outcome_OUTCOME_DUPLICATE:  "duplicate",
	farmv1.Outcome_OUTCOME_SUPERSEDED: "superseded",
	farmv1.Outcome_OUTCOME_CONFLICT:   "conflict",
	farmv1.Outcome_OUTCOME_REJECTED:   "rejected",
}

func (m *metrics) countBatch(outcome farmv1.Outcome, segments int) {
	m.batches.WithLabelValues(outcomeNames[outcome]).Inc()
	m.segments.WithLabelValues(outcomeNames[outcome]).Add(float64(segments))
}

// countMerged counts the work of a batch.
func (m *metrics) countMerged(batch *merge.Batch) {
	var counts tally.Counts
	for i := range batch.Segments {
		counts.Add(batch.Segments[i].Counts)
	}
	m.cpuSeconds.Add(batch.CPUSeconds)
	m.mutations.Add(float64(counts.Mutations))
	m.rays.Add(float64(counts.Rays))
	m.evaluations.Add(float64(counts.PathEvaluations))
	m.trapped.Add(float64(counts.ChainsTrapped))
	for kind, n := range counts.AnomalyMap() {
		m.anomalies.WithLabelValues(kind).Add(float64(n))
	}
	m.countProposals(&counts)
}

func (m *metrics) countProposals(counts *tally.Counts) {
	for _, k := range []struct {
		kind               string
		proposed, accepted uint64
	}{
		{"large", counts.LargeSteps, counts.LargeAccepted},
		{"small", counts.SmallSteps, counts.SmallAccepted},
		{"subpath", counts.SubpathSteps, counts.SubpathAccepted},
		{"second", counts.SecondStages, counts.SecondAccepted},
		{"second_after_large", counts.SecondAfterLarge, counts.SecondAfterLargeAccepted},
	} {
		m.proposed.WithLabelValues(k.kind).Add(float64(k.proposed))
		m.accepted.WithLabelValues(k.kind).Add(float64(k.accepted))
	}
}

func (d *Delivery) countTiles(tiles []*farmv1.Tile) {
	n := 0
	for _, t := range tiles {
		n += len(t.GetData())
	}
	d.bytes += n
	d.memory += int64(n)
	d.c.merging.Grow(int64(n))
	d.c.metrics.deliveredBytes.Add(float64(n))
}

// meteredWriter counts what is written.
type meteredWriter struct {
	io.Writer
	bytes prometheus.Counter
	count int // since Writer was set
}

func (w *meteredWriter) Write(p []byte) (int, error) {
	n, err := w.Writer.Write(p)
	w.bytes.Add(float64(n))
	w.count += n
	return n, err
}

// Collector exports the coordinator's metrics; all names begin with metrofarm_.
func (c *Coordinator) Collector() prometheus.Collector { return c.metrics }

// Describe implements prometheus.Collector.
func (m *metrics) Describe(out chan<- *prometheus.Desc) {
	for _, part := range m.parts {
		part.Describe(out)
	}
	m.gauges.describe(out)
}

// Collect implements prometheus.Collector.
func (m *metrics) Collect(out chan<- prometheus.Metric) {
	for _, part := range m.parts {
		part.Collect(out)
	}
	m.gauges.collect(out)
}
