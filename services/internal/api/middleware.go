package api

import (
	"log/slog"
	"net"
	"net/http"
	"time"
)

// contentPolicy lets the dashboard load only what this server sends. uPlot and the page set styles
// through the DOM, which needs no exception.
const contentPolicy = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; " +
	"connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"

func (s *server) withMiddleware(next http.Handler) http.Handler {
	crossOrigin := http.NewCrossOriginProtection()
	crossOrigin.SetDenyHandler(http.HandlerFunc(func(w http.ResponseWriter, _ *http.Request) {
		writeProblem(w, http.StatusForbidden, "requests that change something must come from this server's own pages")
	}))
	next = crossOrigin.Handler(next)
	if s.LocalOnly {
		next = localHostsOnly(next)
	}
	return s.logged(withHeaders(withDeadline(next)))
}

func withHeaders(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		header := w.Header()
		header.Set("Content-Security-Policy", contentPolicy)
		header.Set("X-Content-Type-Options", "nosniff")
		header.Set("Referrer-Policy", "no-referrer")
		header.Set("Cross-Origin-Resource-Policy", "same-origin")
		header.Set("Cache-Control", "no-cache")
		next.ServeHTTP(w, r)
	})
}

// withDeadline bounds how long an answer may take to send. Uploads and event streams move their
// deadlines on as they go.
func withDeadline(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		// Recorders in tests have no deadline.
		_ = http.NewResponseController(w).SetWriteDeadline(time.Now().Add(stallTimeout))
		next.ServeHTTP(w, r)
	})
}

// localHostsOnly refuses names other than localhost and addresses.
func localHostsOnly(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		host, _, err := net.SplitHostPort(r.Host)
		if err != nil {
			host = r.Host
		}
		if host != "localhost" && net.ParseIP(host) == nil {
			writeProblem(w, http.StatusMisdirectedRequest, "this server answers to localhost only")
			return
		}
		next.ServeHTTP(w, r)
	})
}

func (s *server) logged(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		start := s.Now()
		recorder := &statusRecorder{ResponseWriter: w, status: http.StatusOK}
		next.ServeHTTP(recorder, r)
		s.logger.LogAttrs(r.Context(), levelOf(r.URL.Path, recorder.status), "request",
			slog.String("method", r.Method),
			slog.String("path", r.URL.Path),
			slog.Int("status", recorder.status),
			slog.Int64("bytes", recorder.bytes),
			slog.Duration("duration", s.Now().Sub(start)),
			slog.String("remote", r.RemoteAddr))
	})
}

// levelOf keeps probes out of the usual log.
func levelOf(path string, status int) slog.Level {
	probe := path == "/healthz" || path == "/readyz" || path == "/metrics"
	switch {
	case status >= http.StatusInternalServerError:
		return slog.LevelError
	case probe:
		return slog.LevelDebug
	default:
		return slog.LevelInfo
	}
}

type statusRecorder struct {
	http.ResponseWriter
	status int
	bytes  int64
}

func (r *statusRecorder) WriteHeader(status int) {
	r.status = status
	r.ResponseWriter.WriteHeader(status)
}

func (r *statusRecorder) Write(p []byte) (int, error) {
	n, err := r.ResponseWriter.Write(p)
	r.bytes += int64(n)
	return n, err
}

// Unwrap lets http.ResponseController find flush and deadlines.
func (r *statusRecorder) Unwrap() http.ResponseWriter { return r.ResponseWriter }
