package api

import (
	"context"
	"io"
	"log/slog"
	"net/http"
	"time"

	"github.com/danielgtaylor/huma/v2"
	"github.com/danielgtaylor/huma/v2/adapters/humago"
	"github.com/prometheus/client_golang/prometheus"
	"github.com/prometheus/client_golang/prometheus/promhttp"

	"metrofarm/services/internal/bundle"
)

// Scenes is where uploaded bundles go.
type Scenes interface {
	AddArchive(ctx context.Context, r io.Reader) (bundle.Scene, error)
	Scene(digest string) (bundle.Scene, error)
}

// Options are what the interface is made of.
type Options struct {
	// Service runs the jobs.
	Service Service
	// Scenes holds the bundles.
	Scenes Scenes
	// Metrics are served at /metrics; nil: none.
	Metrics prometheus.Gatherer
	// Logger for requests; nil: discard.
	Logger *slog.Logger
	// Ready tells whether requests can be served; nil: always.
	Ready func(context.Context) error
	// Version of the program, shown in the OpenAPI document.
	Version string
	// Heartbeat is the time between comments on a quiet event stream; 0: 15 s.
	Heartbeat time.Duration
	// LocalOnly refuses requests whose Host header is a foreign name, so that a web page cannot
	// reach a coordinator on this machine by pointing its own name here.
	LocalOnly bool
	// Now is the clock; nil: time.Now.
	Now func() time.Time
}

type server struct {
	Options
	logger *slog.Logger
	mux    *http.ServeMux
}

// Limits of requests and connections.
const (
	jsonBodyLimit     = 4 << 20
	jsonBodyTimeout   = 30 * time.Second
	stallTimeout      = 60 * time.Second // for one read or write
	headerTimeout     = 10 * time.Second
	idleTimeout       = 2 * time.Minute
	headerLimit       = 64 << 10
	defaultHeartbeat  = 15 * time.Second
	defaultListLength = 50
	maxListLength     = 200
)

// NewHandler builds the interface.
func NewHandler(options Options) http.Handler {
	s := &server{Options: options, logger: options.Logger, mux: http.NewServeMux()}
	if s.logger == nil {
		s.logger = slog.New(slog.DiscardHandler)
	}
	if s.Heartbeat == 0 {
		s.Heartbeat = defaultHeartbeat
	}
	if s.Now == nil {
		s.Now = time.Now
	}
	if s.Metrics == nil {
		s.Metrics = prometheus.NewRegistry()
	}
	s.register(humago.New(s.mux, config(options.Version)))
	return s.withMiddleware(s.mux)
}

// NewHTTPServer wraps a handler in a server whose limits keep slow or silent clients from holding
// connections.
func NewHTTPServer(handler http.Handler, logger *slog.Logger) *http.Server {
	return &http.Server{
		Handler:           handler,
		ReadHeaderTimeout: headerTimeout,
		IdleTimeout:       idleTimeout,
		MaxHeaderBytes:    headerLimit,
		ErrorLog:          slog.NewLogLogger(logger.Handler(), slog.LevelWarn),
	}
}

func config(version string) huma.Config {
	c := huma.DefaultConfig("Metrofarm", version)
	c.Info.Description = "Renders scenes with Metropolis light transport on one machine or many. " +
		"Errors are problem details (RFC 9457); errors[].location names the field."
	c.DocsPath = "" // huma's page loads scripts from elsewhere; ours is in docs.go
	c.SchemasPath = ""
	c.CreateHooks = nil // no "$schema" members in answers
	c.RejectUnknownQueryParameters = true
	return c
}

func (s *server) register(api huma.API) {
	s.registerScenes(api)
	s.registerJobs(api)
	s.registerActions(api)
	s.registerDetails(api)
	s.registerImages(api)
	s.registerEvents(api)
	s.registerWorkers(api)
	s.registerHealth(api)
	s.mux.Handle("GET /metrics", promhttp.HandlerFor(s.Metrics, promhttp.HandlerOpts{}))
	s.mux.Handle("GET /docs", docsPage(api.OpenAPI()))
	s.mux.Handle("/", dashboard())
	s.mux.HandleFunc("/v1/", s.unmatched)
}

// unmatched answers requests below /v1/ that no operation takes: 405 where another method would do.
func (s *server) unmatched(w http.ResponseWriter, r *http.Request) {
	for _, method := range []string{http.MethodGet, http.MethodPost, http.MethodDelete} {
		other := r.Clone(r.Context())
		other.Method = method
		if _, pattern := s.mux.Handler(other); pattern != "/v1/" {
			w.Header().Add("Allow", method)
		}
	}
	if w.Header().Get("Allow") != "" {
		writeProblem(w, http.StatusMethodNotAllowed, r.Method+" is not possible on "+r.URL.Path)
		return
	}
	writeProblem(w, http.StatusNotFound, "there is nothing at "+r.URL.Path)
}
