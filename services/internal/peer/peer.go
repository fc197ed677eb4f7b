// Package peer makes the coordinators that share a store look like one: a request about a job goes to
// the coordinator that owns it, and lists show the jobs and workers of all. Coordinators reach each
// other by their REST interfaces; a request that comes from another one is marked by a header and is
// answered from this coordinator alone, so that nothing goes round in circles. What the caller shows
// goes along: a token, or the cookie of a session. The header holds a secret of the one that is asked,
// which only those know that share its store: a request that has it was counted before and was made by
// one of our own pages, if by a page.
package peer

import (
	"cmp"
	"context"
	"crypto/subtle"
	"crypto/tls"
	"log/slog"
	"maps"
	"net"
	"net/http"
	"net/http/httputil"
	"net/url"
	"strings"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// forwardedHeader marks requests of other coordinators.
const forwardedHeader = "Metrofarm-Forwarded"

const (
	connectTimeout = 2 * time.Second
	// answerTimeout is until an answer begins: a large image takes long to develop.
	answerTimeout = 60 * time.Second
	// stallTimeout is for one write to a client.
	stallTimeout = 60 * time.Second
	idleTimeout  = 30 * time.Second
	idlePerPeer  = 32
)

// Coordinator is what this package needs of the coordinator of this process.
type Coordinator interface {
	api.Service
	// Owner returns the coordinator to ask about a job, the zero Member if it is this one.
	Owner(ctx context.Context, id string) (store.Member, error)
	// Peers returns the other coordinators.
	Peers(ctx context.Context) ([]store.Member, error)
	// Own returns the jobs that this coordinator owns, newest first.
	Own() []job.Snapshot
}

// Farm is the api.Service of all coordinators together.
type Farm struct {
	Coordinator
	secret string
	log    *slog.Logger
	client *http.Client
	proxy  *httputil.ReverseProxy
}

var _ api.Service = (*Farm)(nil)

// Options of a farm; Logger is required.
type Options struct {
	Logger *slog.Logger
	// Secret that others send to this coordinator, as its store.Member says; empty: nobody does.
	Secret string
	// TLS trusts the other coordinators; nil: as this machine does.
	TLS *tls.Config
}

// New returns the farm that a coordinator belongs to.
func New(c Coordinator, o Options) *Farm {
	transport := &http.Transport{
		TLSClientConfig:       o.TLS,
		DialContext:           (&net.Dialer{Timeout: connectTimeout}).DialContext,
		TLSHandshakeTimeout:   connectTimeout,
		ResponseHeaderTimeout: answerTimeout,
		IdleConnTimeout:       idleTimeout,
		MaxIdleConnsPerHost:   idlePerPeer,
	}
	f := &Farm{Coordinator: c, secret: o.Secret, log: o.Logger, client: &http.Client{Transport: transport}}
	f.proxy = &httputil.ReverseProxy{
		Rewrite: rewrite, Transport: transport, ErrorHandler: f.unreachable,
		FlushInterval: -1, // events are passed on at once
		ErrorLog:      slog.NewLogLogger(o.Logger.Handler(), slog.LevelDebug),
	}
	return f
}

// Values of request contexts.
type (
	aloneKey  struct{} // the request comes from another coordinator
	callerKey struct{} // what its caller shows: a header
	targetKey struct{} // where it is forwarded to
)

func alone(ctx context.Context) bool { return ctx.Value(aloneKey{}) != nil }

// target of a request that is forwarded.
type target struct {
	url    *url.URL
	secret string
}

// Forwarded tells whether a request was passed on by another coordinator of this farm.
func (f *Farm) Forwarded(r *http.Request) bool {
	given := r.Header.Get(forwardedHeader)
	return f.secret != "" && subtle.ConstantTimeCompare([]byte(given), []byte(f.secret)) == 1
}

// Forward passes requests about jobs of other coordinators on to them.
func (f *Farm) Forward(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		ctx := context.WithValue(r.Context(), callerKey{}, shown(r))
		if r.Header.Get(forwardedHeader) != "" {
			next.ServeHTTP(w, r.WithContext(context.WithValue(ctx, aloneKey{}, true)))
			return
		}
		r = r.WithContext(ctx)
		id, about := jobOf(r.URL.Path)
		if !about {
			next.ServeHTTP(w, r)
			return
		}
		owner, err := f.Owner(ctx, id)
		if err != nil {
			f.log.WarnContext(ctx, "the owner of a job cannot be told", "job", id, "error", err)
			api.Unavailable(w, "it cannot be told which coordinator runs the job; try again")
			return
		}
		if owner.REST == "" {
			next.ServeHTTP(w, r)
			return
		}
		f.forward(w, r, owner)
	})
}

// jobOf returns the job that a path is about.
func jobOf(path string) (id string, about bool) {
	rest, about := strings.CutPrefix(path, "/v1/jobs/")
	id, _, _ = strings.Cut(rest, "/")
	return id, about && id != ""
}

func (f *Farm) forward(w http.ResponseWriter, r *http.Request, owner store.Member) {
	at, err := url.Parse(owner.REST)
	if err != nil {
		f.unreachable(w, r, err)
		return
	}
	clear(w.Header()) // the owner sets its own
	patient := &patientWriter{ResponseWriter: w, control: http.NewResponseController(w)}
	f.proxy.ServeHTTP(patient, r.WithContext(context.WithValue(r.Context(), targetKey{}, target{at, owner.Secret})))
}

// rewrite is called for requests that carry their target.
func rewrite(p *httputil.ProxyRequest) {
	to := p.In.Context().Value(targetKey{}).(target)
	p.SetURL(to.url)
	p.SetXForwarded()
	p.Out.Header.Del("Origin")
	maps.Copy(p.Out.Header, shown(p.In))
	p.Out.Header.Set(forwardedHeader, marked(to.secret))
}

// shown is what tells another coordinator who makes a request. Where it comes from was checked: to the
// other, it comes from its own page.
func shown(r *http.Request) http.Header {
	header := http.Header{"Sec-Fetch-Site": {"same-origin"}}
	for _, name := range []string{"Authorization", "Cookie"} {
		if values := r.Header.Values(name); len(values) > 0 {
			header[name] = values
		}
	}
	if api.OverTLS(r.TLS, r.Header.Get(api.ForwardedProto)) { // by which the cookie is named
		header.Set(api.ForwardedProto, "https")
	}
	return header
}

// marked is the header's value; without a secret, the mark alone narrows the answer.
func marked(secret string) string { return cmp.Or(secret, "1") }

func (f *Farm) unreachable(w http.ResponseWriter, r *http.Request, err error) {
	if r.Context().Err() != nil {
		return // the client has left
	}
	f.log.WarnContext(r.Context(), "a coordinator does not answer", "path", r.URL.Path, "error", err)
	api.Unavailable(w, "the coordinator that runs the job does not answer; if it is gone, another one takes over within seconds")
}

// patientWriter gives each write its time, as event streams never end.
type patientWriter struct {
	http.ResponseWriter
	control *http.ResponseController
}

func (w *patientWriter) Write(p []byte) (int, error) {
	// Recorders in tests have no deadline.
	_ = w.control.SetWriteDeadline(time.Now().Add(stallTimeout))
	return w.ResponseWriter.Write(p)
}

// Unwrap lets http.ResponseController find flush.
func (w *patientWriter) Unwrap() http.ResponseWriter { return w.ResponseWriter }
