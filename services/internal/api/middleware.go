package api

import (
	"cmp"
	"context"
	"log/slog"
	"net/http"
	"time"

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/logging"
)

// contentPolicy lets the dashboard load only what this server sends. uPlot and the page set styles
// through the DOM, which needs no exception.
const contentPolicy = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; " +
	"connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"

// withMiddleware surrounds the routes; what comes last here comes first for a request.
func (s *server) withMiddleware(next http.Handler) http.Handler {
	next = s.allowed(s.whileAllowed(withDeadline(next)))
	crossOrigin := http.NewCrossOriginProtection()
	crossOrigin.SetDenyHandler(http.HandlerFunc(func(w http.ResponseWriter, _ *http.Request) {
		writeProblem(w, http.StatusForbidden, "requests that change something must come from this server's own pages")
	}))
	next = s.paced(crossOrigin.Handler(next))
	if s.CheckHosts {
		next = knownHosts(s.Hosts, next)
	}
	return traced(s.received(s.identified(s.logged(withHeaders(next)))))
}

// traced makes what is logged about a request part of the trace that its client is in.
func traced(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) { next.ServeHTTP(w, logging.WithTrace(r)) })
}

// countedKey marks the contexts of requests that another coordinator has counted.
type countedKey struct{}

// received sees to it that requests which another coordinator passed on are taken as its client's.
func (s *server) received(next http.Handler) http.Handler {
	if s.Forwarded == nil {
		return next
	}
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		if s.Forwarded(r) {
			r = r.WithContext(context.WithValue(r.Context(), countedKey{}, true))
			r.RemoteAddr = cmp.Or(r.Header.Get("X-Forwarded-For"), r.RemoteAddr)
		}
		next.ServeHTTP(w, r)
	})
}

func withHeaders(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		header := w.Header()
		header.Set("Content-Security-Policy", contentPolicy)
		header.Set("X-Content-Type-Options", "nosniff")
		header.Set("Referrer-Policy", "no-referrer")
		header.Set("Cross-Origin-Resource-Policy", "same-origin")
		header.Set("Cross-Origin-Opener-Policy", "same-origin")
		header.Set("X-Frame-Options", "DENY") // for browsers that do not know frame-ancestors
		header.Set("Cache-Control", "private, no-cache")
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

// logged keeps a record of who did what. It holds nothing of a request's headers or query, where
// secrets could be.
func (s *server) logged(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		start := s.Now()
		recorder := &statusRecorder{ResponseWriter: w, status: http.StatusOK}
		next.ServeHTTP(recorder, r)
		took := s.Now().Sub(start)
		s.count(r, recorder, took)
		s.logger.LogAttrs(r.Context(), levelOf(r.URL.Path, recorder.status), "request",
			slog.String("user", auth.From(r.Context()).User),
			slog.String("method", r.Method),
			slog.String("path", r.URL.Path),
			slog.Int("status", recorder.status),
			slog.Int64("bytes", recorder.bytes),
			slog.Duration("duration", took),
			slog.String("remote", r.RemoteAddr))
	})
}

// levelOf keeps probes out of the usual log.
func levelOf(path string, status int) slog.Level {
	switch {
	case status >= http.StatusInternalServerError:
		return slog.LevelError
	case isProbe(path) || path == "/metrics":
		return slog.LevelDebug
	default:
		return slog.LevelInfo
	}
}

func isProbe(path string) bool { return path == "/healthz" || path == "/readyz" }

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
