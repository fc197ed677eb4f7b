package coordinator

import (
	"math"
	"slices"
	"time"

	"github.com/prometheus/client_golang/prometheus"

	"metrofarm/services/internal/job"
)

// gauges are made from the coordinator's state whenever somebody asks.
type gauges struct {
	c *Coordinator

	jobs, paused, queuedSeconds, desired, tasks, relMSE *prometheus.Desc
	workers, threads                                    *prometheus.Desc
	checkpointAge, heldBatches, heldBytes, slots        *prometheus.Desc
	queueBytes, queuePeak, budget                       *prometheus.Desc
	waiting, films, filmsBudget                         *prometheus.Desc
}

func newGauges(c *Coordinator) gauges {
	desc := func(name, help string, labels ...string) *prometheus.Desc {
		return prometheus.NewDesc(name, help, labels, nil)
	}
	return gauges{
		c:             c,
		jobs:          desc("metrofarm_jobs", "Jobs of this coordinator by state; of those that have ended, since it started.", "state"),
		paused:        desc("metrofarm_jobs_paused", "Jobs that have not ended and are paused, by state.", "state"),
		queuedSeconds: desc("metrofarm_oldest_queued_job_seconds", "How long the oldest job that no worker has looked at waits. Those that are paused or wait for memory are not among them."),
		desired: desc("metrofarm_desired_workers", "Workers that the jobs could use: for each job that has not ended, "+
			"is not paused and does not wait for memory one, and one for every 16 segments of a whole round."),
		tasks: desc("metrofarm_open_tasks", "Tasks that are waiting or leased."),
		relMSE: desc("metrofarm_rel_mse", "Estimated relative mean squared error after the last round, over the jobs "+
			"that are rendered and have an estimate; NaN if none has.", "statistic"),
		workers:       desc("metrofarm_workers", "Workers by state.", "state"),
		threads:       desc("metrofarm_render_threads", "Render threads of the workers that may be counted on: not lost, draining, excluded or in quarantine."),
		checkpointAge: desc("metrofarm_checkpoint_age_seconds", "Age of the oldest last checkpoint of a job that has merged work since; 0 if none has."),
		heldBatches:   desc("metrofarm_held_batches", "Batches that wait for a second worker to confirm a part of them."),
		heldBytes:     desc("metrofarm_held_bytes", "Bytes of these, packed."),
		queueBytes:    desc("metrofarm_merge_queue_bytes", "Memory of the batches that are being read: headers, tiles packed and unpacked."),
		queuePeak:     desc("metrofarm_merge_queue_peak_bytes", "The most memory that these and the held batches took since the start."),
		budget:        desc("metrofarm_merge_budget_bytes", "Memory that these and the held batches may take; beyond it batches wait and leases are withheld."),
		waiting:       desc("metrofarm_jobs_waiting_for_memory", "Jobs that are queued until there is room for their films, without those that are paused."),
		films:         desc("metrofarm_films_bytes", "Memory that the films and chains of all jobs may take, as estimated."),
		filmsBudget:   desc("metrofarm_films_budget_bytes", "Memory that they may take together; jobs beyond it wait. +Inf: no bound."),
		slots:         desc("metrofarm_merge_slots", "Batches that can be unpacked at a time; more wait."),
	}
}

func (g *gauges) describe(out chan<- *prometheus.Desc) {
	for _, d := range []*prometheus.Desc{
		g.jobs, g.paused, g.queuedSeconds, g.desired, g.tasks, g.relMSE, g.workers, g.threads,
		g.checkpointAge, g.heldBatches, g.heldBytes, g.slots, g.queueBytes, g.queuePeak, g.budget,
		g.waiting, g.films, g.filmsBudget,
	} {
		out <- d
	}
}

// farmState is what the gauges show of all jobs.
type farmState struct {
	states, paused             map[job.State]int
	tasks, desired             int
	waiting                    int
	heldBatches, heldBytes     int
	queuedSeconds, oldestCheck float64
	errors                     []float64
}

func (g *gauges) collect(out chan<- prometheus.Metric) {
	var all farmState
	all.states, all.paused = make(map[job.State]int), make(map[job.State]int)
	now := g.c.options.Now()
	for _, r := range g.c.runs() {
		r.mu.Lock()
		r.addTo(&all, now)
		r.mu.Unlock()
	}
	g.c.mu.Lock()
	for state, n := range g.c.ended {
		all.states[state] += n
	}
	g.c.mu.Unlock()
	gauge := func(d *prometheus.Desc, v float64, labels ...string) {
		out <- prometheus.MustNewConstMetric(d, prometheus.GaugeValue, v, labels...)
	}
	for _, s := range []job.State{job.Queued, job.Inspecting, job.Bootstrapping, job.Rendering, job.Done, job.Failed, job.Canceled} {
		gauge(g.jobs, float64(all.states[s]), string(s))
		if !s.Ended() {
			gauge(g.paused, float64(all.paused[s]), string(s))
		}
	}
	gauge(g.queuedSeconds, all.queuedSeconds)
	gauge(g.desired, float64(all.desired))
	gauge(g.tasks, float64(all.tasks))
	gauge(g.checkpointAge, all.oldestCheck)
	gauge(g.heldBatches, float64(all.heldBatches))
	gauge(g.heldBytes, float64(all.heldBytes))
	gauge(g.slots, float64(g.c.options.Deliveries))
	gauge(g.queueBytes, float64(g.c.merging.Bytes()))
	gauge(g.queuePeak, float64(g.c.merging.Peak()))
	gauge(g.budget, float64(g.c.options.MergeBudget))
	g.collectRoom(gauge, all.waiting)
	lowest, median, highest := summarize(all.errors)
	gauge(g.relMSE, lowest, "lowest")
	gauge(g.relMSE, median, "median")
	gauge(g.relMSE, highest, "highest")
	g.collectWorkers(gauge)
}

func (g *gauges) collectRoom(gauge func(*prometheus.Desc, float64, ...string), waiting int) {
	used, budget := g.c.room.state()
	most := float64(budget)
	if budget == 0 {
		most = math.Inf(1)
	}
	gauge(g.waiting, float64(waiting))
	gauge(g.films, float64(used))
	gauge(g.filmsBudget, most)
}

// summarize returns NaN where there is nothing.
func summarize(values []float64) (lowest, median, highest float64) {
	if len(values) == 0 {
		return math.NaN(), math.NaN(), math.NaN()
	}
	slices.Sort(values)
	return values[0], values[len(values)/2], values[len(values)-1]
}

// addTo requires: mu.
func (r *run) addTo(all *farmState, now time.Time) {
	all.states[r.rec.State]++
	all.tasks += r.table.Open()
	all.desired += r.wantedWorkers()
	if r.rec.Paused && !r.rec.State.Ended() {
		all.paused[r.rec.State]++
	}
	for _, h := range r.checks.held {
		all.heldBatches++
		all.heldBytes += h.bytes
	}
	if r.waitingForRoom() && !r.rec.Paused {
		all.waiting++
	}
	switch r.rec.State {
	case job.Queued:
		if r.waitingForRoom() || r.rec.Paused {
			return
		}
		all.queuedSeconds = max(all.queuedSeconds, now.Sub(r.rec.CreatedAt).Seconds())
	case job.Rendering:
		if r.dirty && !r.lastCheckpoint.IsZero() {
			all.oldestCheck = max(all.oldestCheck, now.Sub(r.lastCheckpoint).Seconds())
		}
		if r.state == nil {
			return
		}
		if points := r.state.History(); len(points) > 0 && known(points[len(points)-1]) {
			all.errors = append(all.errors, points[len(points)-1].RelMSE)
		}
	}
}

// wantedWorkers is what the job adds to the number that a scaler is told. Requires: mu.
func (r *run) wantedWorkers() int {
	s := job.Snapshot{State: r.rec.State, Paused: r.rec.Paused, WaitingForMemory: r.waitingForRoom()}
	r.describePhase(&s)
	return s.WantedWorkers()
}

func (g *gauges) collectWorkers(gauge func(*prometheus.Desc, float64, ...string)) {
	held := g.c.heldByWorker()
	counts := map[string]int{"idle": 0, "busy": 0, "quarantined": 0, "draining": 0, "lost": 0}
	threads := 0
	g.c.mu.Lock()
	for _, w := range g.c.workers {
		counts[g.c.workerView(w, held[w.id]).State]++
		if g.c.renders(w) {
			threads += w.threads
		}
	}
	g.c.mu.Unlock()
	for state, n := range counts {
		gauge(g.workers, float64(n), state)
	}
	gauge(g.threads, float64(threads))
}
