package api

import (
	"net/http"
	"slices"
	"strconv"
	"strings"
	"time"

	"github.com/prometheus/client_golang/prometheus"
)

// metrics of the interface. Routes are those of the multiplexer and methods known ones, so that
// clients cannot make series.
type metrics struct {
	requests *prometheus.CounterVec
	seconds  *prometheus.HistogramVec
	streams  prometheus.Gauge
}

func newMetrics() *metrics {
	m := &metrics{
		requests: prometheus.NewCounterVec(prometheus.CounterOpts{
			Name: "metrofarm_http_requests_total", Help: "Requests by route, method and status code.",
		}, []string{"route", "method", "code"}),
		seconds: prometheus.NewHistogramVec(prometheus.HistogramOpts{
			Name: "metrofarm_http_request_duration_seconds", Help: "Time to answer requests, event streams left out.",
			Buckets: prometheus.ExponentialBuckets(0.001, 4, 8),
		}, []string{"route"}),
		streams: prometheus.NewGauge(prometheus.GaugeOpts{
			Name: "metrofarm_sse_clients", Help: "Clients that follow events of a job.",
		}),
	}
	return m
}

// gather adds the interface's own metrics to others.
func (m *metrics) gather(others prometheus.Gatherer) prometheus.Gatherer {
	own := prometheus.NewRegistry()
	own.MustRegister(m.requests, m.seconds, m.streams)
	return prometheus.Gatherers{others, own}
}

var knownMethods = []string{
	http.MethodGet, http.MethodHead, http.MethodPost, http.MethodPut, http.MethodPatch, http.MethodDelete, http.MethodOptions,
}

// count a request that was answered.
func (s *server) count(r *http.Request, answer *statusRecorder, took time.Duration) {
	_, pattern := s.routes.mux.Handler(r)
	route := pattern[strings.IndexByte(pattern, ' ')+1:]
	method := r.Method
	if !slices.Contains(knownMethods, method) {
		method = "other"
	}
	s.metrics.requests.WithLabelValues(route, method, strconv.Itoa(answer.status)).Inc()
	if answer.Header().Get("Content-Type") != eventStreamType {
		s.metrics.seconds.WithLabelValues(route).Observe(took.Seconds())
	}
}
