package api

import (
	"fmt"
	"net/http"
	"strings"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
)

// Names of the security schemes in the OpenAPI document.
const (
	tokenScheme   = "token"
	sessionScheme = "session"
)

// needs is the security of an operation: a token, or a session that stands for one, with the role.
func needs(role auth.Role) []map[string][]string {
	return []map[string][]string{{tokenScheme: {role.String()}}, {sessionScheme: {role.String()}}}
}

// openToAll is the security of an operation that asks for nothing. An operation that names no
// security at all is a mistake.
func openToAll() []map[string][]string { return []map[string][]string{} }

// roleOf an operation is what its description asks for.
func roleOf(operation *huma.Operation) (auth.Role, error) {
	switch {
	case operation.Security == nil:
		return auth.None, fmt.Errorf("operation %s does not say which role it needs", operation.OperationID)
	case len(operation.Security) == 0:
		return auth.None, nil
	}
	return auth.ParseRole(strings.Join(operation.Security[0][tokenScheme], " "))
}

// routes is the multiplexer, with the role that each of its patterns needs.
type routes struct {
	mux   *http.ServeMux
	roles map[string]auth.Role
	// pending patterns have no role yet: huma adds those of its operations before it describes them.
	pending []string
}

func newRoutes() *routes {
	return &routes{mux: http.NewServeMux(), roles: make(map[string]auth.Role)}
}

// HandleFunc lets huma add operations.
func (r *routes) HandleFunc(pattern string, handler func(http.ResponseWriter, *http.Request)) {
	r.mux.HandleFunc(pattern, handler)
	r.pending = append(r.pending, pattern)
}

// ServeHTTP passes requests on.
func (r *routes) ServeHTTP(w http.ResponseWriter, request *http.Request) {
	r.mux.ServeHTTP(w, request)
}

// handle adds a handler that is no operation.
func (r *routes) handle(pattern string, role auth.Role, handler http.Handler) {
	r.mux.Handle(pattern, handler)
	r.roles[pattern] = role
}

// settle takes the roles of huma's patterns from the document; those that serve the document itself
// need described.
func (r *routes) settle(document *huma.OpenAPI, described auth.Role) error {
	for path, item := range document.Paths {
		for _, operation := range []*huma.Operation{item.Get, item.Post, item.Put, item.Patch, item.Delete} {
			if operation == nil {
				continue
			}
			role, err := roleOf(operation)
			if err != nil {
				return err
			}
			r.roles[operation.Method+" "+path] = role
		}
	}
	for _, pattern := range r.pending {
		if strings.HasPrefix(pattern, "GET /openapi") {
			r.roles[pattern] = described
		}
		if _, settled := r.roles[pattern]; !settled {
			return fmt.Errorf("route %s does not say which role it needs", pattern)
		}
	}
	r.pending = nil
	return nil
}

// role that a request needs. A pattern that nobody settled needs the highest.
func (r *routes) role(request *http.Request) auth.Role {
	_, pattern := r.mux.Handler(request)
	if role, settled := r.roles[pattern]; settled {
		return role
	}
	return auth.Admin
}
