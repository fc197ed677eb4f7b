// Package auth decides who makes a request and what they may do: bearer tokens with roles, kept as
// hashes in a file, and sessions for browsers, which are signed cookies that stand for a token.
package auth

import "fmt"

// Role of a token. Each includes those before it.
type Role int

// The roles.
const (
	// None may see what is open to all.
	None Role = iota
	// Read sees jobs, images and workers.
	Read
	// Submit uploads scenes, submits jobs and acts on them.
	Submit
	// Admin drains workers and deletes the jobs of others.
	Admin
)

var roleNames = [...]string{"none", "read", "submit", "admin"}

func (r Role) String() string { return roleNames[r] }

// Includes tells whether the role may do what another one may.
func (r Role) Includes(other Role) bool { return r >= other }

// ParseRole reads the role of a token.
func ParseRole(name string) (Role, error) {
	for role := Read; role <= Admin; role++ {
		if roleNames[role] == name {
			return role, nil
		}
	}
	return None, fmt.Errorf("role %q: want read, submit or admin", name)
}
