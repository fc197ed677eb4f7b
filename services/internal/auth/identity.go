package auth

import (
	"context"
	"crypto/sha256"
	"encoding/hex"
)

// Hash of a token, which is what the server keeps.
type Hash [sha256.Size]byte

// Identity is who makes a request.
type Identity struct {
	// User is the name beside the token; empty where there are no tokens, or none was given.
	User string
	Role Role
	// token is what a session stands for.
	token Hash
	// BySession: a cookie said so, which a browser sends by itself.
	BySession bool
}

// Anyone is who makes requests where there are no tokens.
func Anyone() Identity { return Identity{Role: Admin} }

type identityKey struct{}

// With returns a context that carries an identity.
func With(ctx context.Context, who Identity) context.Context {
	return context.WithValue(ctx, identityKey{}, who)
}

// From returns the identity of a request; the zero value, which may do nothing, without one.
func From(ctx context.Context) Identity {
	who, _ := ctx.Value(identityKey{}).(Identity)
	return who
}

// Key tells tokens apart without telling what they are; false where no token was given.
func (i Identity) Key() (string, bool) {
	if i.token == (Hash{}) {
		return "", false
	}
	claim := i.claim()
	return "token " + hex.EncodeToString(claim[:8]), true
}

// claim is what a session says about its token: the hash of its hash.
func (i Identity) claim() Hash { return sha256.Sum256(i.token[:]) }
