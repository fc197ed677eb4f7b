package api

import (
	"crypto/tls"
	"errors"
	"fmt"
	"net"
	"net/http"
	"slices"
	"strings"

	"metrofarm/services/internal/auth"
)

// Names of the session's cookie. Browsers take the first only over TLS, for the whole of this host
// and for no other.
const (
	secureCookie = "__Host-metrofarm"
	plainCookie  = "metrofarm"
)

// ForwardedProto is where a proxy tells what the client speaks.
const ForwardedProto = "X-Forwarded-Proto"

// identified finds out who makes a request; whether they may is decided later.
func (s *server) identified(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		next.ServeHTTP(w, r.WithContext(auth.With(r.Context(), s.identify(r))))
	})
}

// identify returns the zero identity for requests without a valid token or session.
func (s *server) identify(r *http.Request) auth.Identity {
	if s.Tokens == nil {
		return auth.Anyone()
	}
	if given := r.Header.Values("Authorization"); len(given) > 0 {
		scheme, token, _ := strings.Cut(given[0], " ")
		if len(given) > 1 || !strings.EqualFold(scheme, "Bearer") {
			return auth.Identity{}
		}
		who, _ := s.Tokens.Find(token)
		return who
	}
	if cookie, err := r.Cookie(cookieName(OverTLS(r.TLS, r.Header.Get(ForwardedProto)))); err == nil {
		who, _ := s.sessions.Find(cookie.Value)
		return who
	}
	return auth.Identity{}
}

// OverTLS tells whether the client speaks TLS, to us or to a proxy before us. Who lies about it gets
// a cookie that their browser does not send back.
func OverTLS(connection *tls.ConnectionState, forwarded string) bool {
	return connection != nil || forwarded == "https"
}

func cookieName(secure bool) string {
	if secure {
		return secureCookie
	}
	return plainCookie
}

// allowed refuses requests whose makers lack the role.
func (s *server) allowed(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		who, needed := auth.From(r.Context()), s.routes.role(r)
		switch {
		case needed == auth.None:
		case who.Role == auth.None:
			refuseUnknown(w, r)
			return
		case !who.Role.Includes(needed):
			w.Header().Set("WWW-Authenticate", fmt.Sprintf(`Bearer realm="metrofarm", error="insufficient_scope", scope="%s"`, needed))
			writeProblem(w, http.StatusForbidden, fmt.Sprintf("this needs the role %s; %s has %s", needed, who.User, who.Role))
			return
		case who.BySession && !fromOwnPage(r):
			writeProblem(w, http.StatusForbidden, "a session changes something only from this server's own pages; use a token")
			return
		}
		next.ServeHTTP(w, r)
	})
}

// errEnded: who reads a stream may not any more.
var errEnded = errors.New("the token or the session has ended")

// whileAllowed ends event streams, which outlive most sessions, with the role of their readers: a token
// may be taken back while one is open. A quiet stream notices with its next comment.
func (s *server) whileAllowed(next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		if s.Tokens != nil && strings.HasSuffix(r.URL.Path, "/events") {
			needed := s.routes.role(r)
			w = &watchedWriter{w, func() bool { return s.identify(r).Role.Includes(needed) }}
		}
		next.ServeHTTP(w, r)
	})
}

// watchedWriter writes as long as its reader may read.
type watchedWriter struct {
	http.ResponseWriter
	allowed func() bool
}

func (w *watchedWriter) Write(p []byte) (int, error) {
	if !w.allowed() {
		return 0, errEnded
	}
	return w.ResponseWriter.Write(p)
}

// Unwrap lets http.ResponseController find flush and deadlines.
func (w *watchedWriter) Unwrap() http.ResponseWriter { return w.ResponseWriter }

func refuseUnknown(w http.ResponseWriter, r *http.Request) {
	challenge, detail := `Bearer realm="metrofarm"`, "this needs a token: Authorization: Bearer TOKEN"
	if r.Header.Get("Authorization") != "" {
		challenge += `, error="invalid_token"`
		detail = "the token is not known here"
	}
	w.Header().Set("WWW-Authenticate", challenge)
	writeProblem(w, http.StatusUnauthorized, detail)
}

// fromOwnPage tells whether the browser says that one of our pages made a request. Requests that
// change nothing may come from anywhere: their answers cannot be read there. An Origin was compared
// with our name before.
func fromOwnPage(r *http.Request) bool {
	if r.Method == http.MethodGet || r.Method == http.MethodHead {
		return true
	}
	if site := r.Header.Get("Sec-Fetch-Site"); site != "" {
		return site == "same-origin"
	}
	return r.Header.Get("Origin") != ""
}

// knownHosts refuses requests that call this server by a name that is not its own, so that a web page
// cannot reach it by pointing the page's name here.
func knownHosts(hosts []string, next http.Handler) http.Handler {
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		host, _, err := net.SplitHostPort(r.Host)
		if err != nil {
			host = strings.Trim(r.Host, "[]")
		}
		ip := net.ParseIP(host)
		known := host == "localhost" || (ip != nil && ip.IsLoopback()) ||
			slices.ContainsFunc(hosts, func(name string) bool { return strings.EqualFold(name, host) })
		if !known {
			writeProblem(w, http.StatusMisdirectedRequest,
				fmt.Sprintf("this server does not answer to the name %q; serve --host adds names", host))
			return
		}
		next.ServeHTTP(w, r)
	})
}
