package api

import (
	"net/http"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/auth"
)

// RolesOf tells which role each route of the interface needs.
func RolesOf(options Options) (map[string]auth.Role, error) {
	s, err := newServer(options)
	if err != nil {
		return nil, err
	}
	return s.routes.roles, nil
}

// Settle tells whether an operation like this one would be taken.
func Settle(operation *huma.Operation) error {
	r := newRoutes()
	r.HandleFunc(operation.Method+" "+operation.Path, func(http.ResponseWriter, *http.Request) {})
	document := &huma.OpenAPI{}
	document.AddOperation(operation)
	return r.settle(document, auth.Read)
}
