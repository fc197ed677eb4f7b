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

	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/bundle"
)

// Scenes is where uploaded bundles go.
type Scenes interface {
	Limits() bundle.Limits
	Scenes(ctx context.Context) ([]bundle.Listed, error)
	AddArchive(ctx context.Context, r io.Reader) (bundle.Scene, error)
	Scene(ctx context.Context, digest string) (bundle.Scene, error)
}

// Options are what the interface is made of.
type Options struct {
	// Service runs the jobs.
	Service Service
	// Scenes holds the bundles.
	Scenes Scenes
	// Metrics are served at /metrics, beside those of the interface; nil: none.
	Metrics prometheus.Gatherer
	// Logger for requests; nil: discard.
	Logger *slog.Logger
	// Forward wraps the operations, inside of the checks of who asks; nil: nothing does.
	Forward func(http.Handler) http.Handler
	// Forwarded tells whether another coordinator passed a request on, which has counted it; nil: none
	// does. X-Forwarded-For then says who asks.
	Forwarded func(*http.Request) bool
	// Ready tells whether requests can be served; nil: always.
	Ready func(context.Context) error
	// Version of the program, shown in the OpenAPI document.
	Version string
	// Tokens that requests must bring; nil: none, and everybody may do everything.
	Tokens *auth.Tokens
	// SessionKey signs the sessions of browsers, SessionTime is how long they last; 0: 12 hours.
	// Coordinators behind one name share the key. Needed with Tokens.
	SessionKey  []byte
	SessionTime time.Duration
	// OpenMetrics serves /metrics without a token.
	OpenMetrics bool
	// Limits on what clients may ask for; the zero value means DefaultLimits.
	Limits Limits
	// Heartbeat is the time between comments on a quiet event stream; 0: 15 s.
	Heartbeat time.Duration
	// FarmInterval is the least time between two messages of a farm stream; 0: 1 s.
	FarmInterval time.Duration
	// CheckHosts refuses requests whose Host header is not localhost, a loopback address or one of
	// Hosts, so that a web page cannot reach a coordinator on this machine by pointing its own name
	// here.
	CheckHosts bool
	Hosts      []string
	// Now is the clock; nil: time.Now.
	Now func() time.Time
}

type server struct {
	Options
	logger   *slog.Logger
	routes   *routes
	gate     *gate
	sessions *auth.Sessions
	metrics  *metrics
	feed     *feed
	pictures *pictures
}

// Limits of requests and connections.
const (
	jsonBodyTimeout  = 30 * time.Second
	stallTimeout     = 60 * time.Second // for one read or write
	headerTimeout    = 10 * time.Second
	idleTimeout      = 2 * time.Minute
	headerLimit      = 64 << 10
	defaultHeartbeat = 15 * time.Second
	defaultSession   = 12 * time.Hour
	maxListLength    = 200
)

// NewHandler builds the interface. It fails if the session key is too short.
func NewHandler(options Options) (http.Handler, error) {
	s, err := newServer(options)
	if err != nil {
		return nil, err
	}
	if s.Forward == nil {
		return s.withMiddleware(s.routes), nil
	}
	return s.withMiddleware(s.Forward(s.routes)), nil
}

func newServer(options Options) (*server, error) {
	s := &server{Options: options, logger: options.Logger, routes: newRoutes(), metrics: newMetrics()}
	s.setDefaults()
	s.gate = newGate(s.Limits, s.Now)
	s.feed = newFeed(s.FarmInterval)
	var err error
	if s.pictures, err = newPictures(s.Service); err != nil {
		return nil, err
	}
	if s.Tokens != nil {
		if s.sessions, err = auth.NewSessions(s.Tokens, s.SessionKey, s.Now); err != nil {
			return nil, err
		}
	}
	return s, s.register(humago.New(s.routes, config(options.Version)))
}

func (s *server) setDefaults() {
	if s.logger == nil {
		s.logger = slog.New(slog.DiscardHandler)
	}
	if s.Heartbeat == 0 {
		s.Heartbeat = defaultHeartbeat
	}
	if s.FarmInterval == 0 {
		s.FarmInterval = farmInterval
	}
	if s.SessionTime == 0 {
		s.SessionTime = defaultSession
	}
	if s.Now == nil {
		s.Now = time.Now
	}
	if s.Metrics == nil {
		s.Metrics = prometheus.NewRegistry()
	}
	if s.Limits == (Limits{}) {
		s.Limits = DefaultLimits()
	}
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
	c.Components.SecuritySchemes = map[string]*huma.SecurityScheme{
		tokenScheme: {Type: "http", Scheme: "bearer", Description: "A token of the server's file of tokens, where it has " +
			"one. Each role includes those before it: read, submit, admin."},
		sessionScheme: {Type: "apiKey", In: "cookie", Name: secureCookie, Description: "For browsers: what POST " +
			"/v1/session sets. Without TLS its name is " + plainCookie + "."},
	}
	c.DocsPath = "" // huma's page loads scripts from elsewhere; ours is in docs.go
	c.SchemasPath = ""
	c.CreateHooks = nil // no "$schema" members in answers
	c.RejectUnknownQueryParameters = true
	return c
}

func (s *server) register(api huma.API) error {
	s.registerScenes(api)
	s.registerJobs(api)
	s.registerActions(api)
	s.registerRefine(api)
	s.registerSequences(api)
	s.registerDetails(api)
	s.registerLog(api)
	s.registerImages(api)
	s.registerEvents(api)
	s.registerFarmEvents(api)
	s.registerWorkers(api)
	s.registerSession(api)
	s.registerHealth(api)
	metrics := auth.Read
	if s.OpenMetrics {
		metrics = auth.None
	}
	s.routes.handle("GET /metrics", metrics, promhttp.HandlerFor(s.metrics.gather(s.Metrics), promhttp.HandlerOpts{}))
	s.routes.handle("GET /docs", auth.Read, docsPage(api.OpenAPI()))
	s.routes.handle("/", auth.None, dashboard()) // files without secrets, which ask for the token
	s.routes.handle("/v1/", auth.Read, http.HandlerFunc(s.unmatched))
	return s.routes.settle(api.OpenAPI(), auth.Read)
}

// unmatched answers requests below /v1/ that no operation takes: 405 where another method would do.
func (s *server) unmatched(w http.ResponseWriter, r *http.Request) {
	for _, method := range []string{http.MethodGet, http.MethodPost, http.MethodPatch, http.MethodDelete} {
		other := r.Clone(r.Context())
		other.Method = method
		if _, pattern := s.routes.mux.Handler(other); pattern != "/v1/" {
			w.Header().Add("Allow", method)
		}
	}
	if w.Header().Get("Allow") != "" {
		writeProblem(w, http.StatusMethodNotAllowed, r.Method+" is not possible on "+r.URL.Path)
		return
	}
	writeProblem(w, http.StatusNotFound, "there is nothing at "+r.URL.Path)
}
