package api

import (
	"fmt"
	"math"
	"net"
	"net/http"
	"net/netip"
	"strconv"
	"sync"
	"time"

	"github.com/danielgtaylor/huma/v2"
	"golang.org/x/time/rate"

	"metrofarm/services/internal/auth"
)

// Limits on what clients may ask of the interface. A client is a token or, without one, an address.
type Limits struct {
	// RequestsPerSecond of one client in the long run, and Burst at once.
	RequestsPerSecond float64
	Burst             int
	// Uploads at a time, of all clients.
	Uploads int
	// UploadPatience is how long an upload may bring nothing, and how long in all it may be behind UploadRate,
	// in bytes per second.
	UploadPatience time.Duration
	UploadRate     int64
	// Streams of events that are open at a time, of one client and of all.
	StreamsPerClient, Streams int
	// BodyBytes of a JSON document.
	BodyBytes int64
}

// DefaultLimits leave room for a farm's people and their scripts.
func DefaultLimits() Limits {
	return Limits{
		RequestsPerSecond: 100, Burst: 400, Uploads: 8, UploadPatience: stallTimeout, UploadRate: 32 << 10,
		StreamsPerClient: 256, Streams: 1024, BodyBytes: 4 << 20,
	}
}

const (
	// maxClients that are told apart; the others share what one may ask for.
	maxClients = 8192
	// retryLater is when to come back after a limit that time alone does not lift.
	retryLater = 5 * time.Second
	// ipv6Network is what one customer of a provider usually has.
	ipv6Network = 64
)

// client is what one client uses.
type client struct {
	rate    *rate.Limiter
	streams int
}

// gate counts what is used of the limits.
type gate struct {
	limits Limits
	now    func() time.Time

	mutex   sync.Mutex
	clients map[string]*client
	others  *client // those that do not fit in clients
	swept   time.Time
	uploads int
	streams int
}

func newGate(limits Limits, now func() time.Time) *gate {
	g := &gate{limits: limits, now: now, clients: make(map[string]*client), swept: now()}
	g.others = g.newClient()
	return g
}

func (g *gate) newClient() *client {
	return &client{rate: rate.NewLimiter(rate.Limit(g.limits.RequestsPerSecond), g.limits.Burst)}
}

// client requires: mutex.
func (g *gate) client(key string) *client {
	if known := g.clients[key]; known != nil {
		return known
	}
	if len(g.clients) >= maxClients {
		g.sweep()
	}
	if len(g.clients) >= maxClients {
		return g.others
	}
	added := g.newClient()
	g.clients[key] = added
	return added
}

// sweep forgets clients that have used nothing for so long that a new one would be alike. Requires:
// mutex.
func (g *gate) sweep() {
	if g.now().Sub(g.swept) < time.Second {
		return
	}
	g.swept = g.now()
	for key, known := range g.clients {
		if known.streams == 0 && known.rate.TokensAt(g.now()) >= float64(g.limits.Burst) {
			delete(g.clients, key)
		}
	}
}

// take one request; false with the time after which there is room for another.
func (g *gate) take(key string) (wait time.Duration, granted bool) {
	g.mutex.Lock()
	defer g.mutex.Unlock()
	reserved := g.client(key).rate.ReserveN(g.now(), 1)
	wait = reserved.DelayFrom(g.now())
	if wait == 0 {
		return 0, true
	}
	reserved.CancelAt(g.now())
	return wait, false
}

// openUpload returns false when there are too many.
func (g *gate) openUpload() bool {
	g.mutex.Lock()
	defer g.mutex.Unlock()
	if g.uploads >= g.limits.Uploads {
		return false
	}
	g.uploads++
	return true
}

func (g *gate) closeUpload() {
	g.mutex.Lock()
	defer g.mutex.Unlock()
	g.uploads--
}

// openStream returns what is to be called at its end, or the status of a refusal.
func (g *gate) openStream(key string) (end func(), refusal int) {
	g.mutex.Lock()
	defer g.mutex.Unlock()
	owner := g.client(key)
	switch {
	case owner.streams >= g.limits.StreamsPerClient:
		return nil, http.StatusTooManyRequests
	case g.streams >= g.limits.Streams:
		return nil, http.StatusServiceUnavailable
	}
	g.streams++
	owner.streams++
	return func() {
		g.mutex.Lock()
		defer g.mutex.Unlock()
		g.streams--
		owner.streams--
	}, 0
}

// clientKey tells clients apart.
func clientKey(who auth.Identity, remote string) string {
	if key, known := who.Key(); known {
		return key
	}
	host, _, err := net.SplitHostPort(remote)
	if err != nil {
		host = remote
	}
	address, err := netip.ParseAddr(host)
	if err != nil {
		return host
	}
	if address = address.Unmap().WithZone(""); address.Is6() {
		network, _ := address.Prefix(ipv6Network) // 64 bits fit
		return network.String()
	}
	return address.String()
}

// paced refuses clients that ask too often. Probes are not counted, nor is what another coordinator has
// counted.
func (s *server) paced(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		if isProbe(r.URL.Path) || r.Context().Value(countedKey{}) != nil {
			next.ServeHTTP(w, r)
			return
		}
		wait, granted := s.gate.take(clientKey(auth.From(r.Context()), r.RemoteAddr))
		if !granted {
			w.Header().Set("Retry-After", seconds(wait))
			writeProblem(w, http.StatusTooManyRequests,
				fmt.Sprintf("more than %g requests per second; come back after Retry-After", s.Limits.RequestsPerSecond))
			return
		}
		next.ServeHTTP(w, r)
	})
}

// seconds of a Retry-After header, rounded up.
func seconds(wait time.Duration) string {
	return strconv.Itoa(max(1, int(math.Ceil(wait.Seconds()))))
}

// limitUploads is a middleware of the operation that takes uploads.
func (s *server) limitUploads(api huma.API) func(huma.Context, func(huma.Context)) {
	return func(ctx huma.Context, next func(huma.Context)) {
		if !s.gate.openUpload() {
			ctx.SetHeader("Retry-After", seconds(retryLater))
			_ = huma.WriteErr(api, ctx, http.StatusServiceUnavailable,
				fmt.Sprintf("%d uploads are under way, the most that there may be", s.Limits.Uploads))
			return
		}
		defer s.gate.closeUpload()
		next(ctx)
	}
}

// limitStreams is a middleware of the operation that streams events.
func (s *server) limitStreams(api huma.API) func(huma.Context, func(huma.Context)) {
	return func(ctx huma.Context, next func(huma.Context)) {
		end, refusal := s.gate.openStream(clientKey(auth.From(ctx.Context()), ctx.RemoteAddr()))
		if end == nil {
			ctx.SetHeader("Retry-After", seconds(retryLater))
			_ = huma.WriteErr(api, ctx, refusal, fmt.Sprintf("too many event streams are open: at most %d of one client, %d of all",
				s.Limits.StreamsPerClient, s.Limits.Streams))
			return
		}
		defer end()
		next(ctx)
	}
}
