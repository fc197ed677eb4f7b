package api

import (
	"context"
	"net/http"
	"time"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
)

type sessionInput struct{ secure bool }

// Resolve notes whether the cookie can be kept to TLS.
func (i *sessionInput) Resolve(ctx huma.Context) []error {
	i.secure = OverTLS(ctx.TLS(), ctx.Header(ForwardedProto))
	return nil
}

type sessionBody struct {
	Tokens bool   `json:"tokens" doc:"Whether this server asks for tokens."`
	User   string `json:"user" doc:"Who makes the request; empty without tokens."`
	Role   string `json:"role" enum:"read,submit,admin" doc:"What they may do."`
}

type sessionOutput struct {
	SetCookie string `header:"Set-Cookie"`
	Body      sessionBody
}

type closedOutput struct {
	SetCookie string `header:"Set-Cookie"`
}

func (s *server) registerSession(api huma.API) {
	register := func(name, method, summary, description string) huma.Operation {
		return huma.Operation{
			OperationID: name, Method: method, Path: "/v1/session", Tags: []string{"session"},
			Summary: summary, Description: description, Security: needs(auth.Read),
		}
	}
	huma.Register(api, register("get-session", http.MethodGet, "Who makes this request", ""), s.session)
	open := register("open-session", http.MethodPost, "Exchange the token for a cookie",
		"For browsers, which cannot send the token with images and event streams. The cookie is out of "+
			"reach of scripts and of other sites, ends after a time and with the token.")
	open.Security = []map[string][]string{{tokenScheme: {auth.Read.String()}}}
	huma.Register(api, open, s.openSession)
	closing := register("close-session", http.MethodDelete, "Forget the cookie", "")
	closing.DefaultStatus = http.StatusNoContent
	huma.Register(api, closing, s.closeSession)
}

func (s *server) session(ctx context.Context, _ *struct{}) (*sessionOutput, error) {
	who := auth.From(ctx)
	return &sessionOutput{Body: sessionBody{Tokens: s.Tokens != nil, User: who.User, Role: who.Role.String()}}, nil
}

func (s *server) openSession(ctx context.Context, input *sessionInput) (*sessionOutput, error) {
	who := auth.From(ctx)
	switch {
	case s.Tokens == nil:
		return nil, huma.Error409Conflict("this server asks for no tokens")
	case who.BySession:
		return nil, huma.Error403Forbidden("a session is opened with a token, not with a session")
	}
	output, err := s.session(ctx, nil)
	if err == nil {
		value := s.sessions.Open(who, s.SessionTime)
		output.SetCookie = cookie(value, s.SessionTime, input.secure)
	}
	return output, err
}

func (s *server) closeSession(_ context.Context, input *sessionInput) (*closedOutput, error) {
	return &closedOutput{SetCookie: cookie("", -time.Second, input.secure)}, nil
}

func cookie(value string, lasts time.Duration, secure bool) string {
	header := http.Cookie{
		Name: cookieName(secure), Value: value, Path: "/", MaxAge: int(lasts.Seconds()),
		HttpOnly: true, SameSite: http.SameSiteStrictMode, Secure: secure,
	}
	return header.String()
}
