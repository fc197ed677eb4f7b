package auth_test

import (
	"bytes"
	"encoding/base64"
	"os"
	"path/filepath"
	"testing"
	"time"

	"metrofarm/services/internal/auth"
)

type sessionBench struct {
	path     string
	tokens   *auth.Tokens
	sessions *auth.Sessions
	now      time.Time
	who      auth.Identity
	line     string
}

func newSessions(t *testing.T) *sessionBench {
	t.Helper()
	token, line := newToken(t, auth.Submit, "alice")
	b := &sessionBench{path: filepath.Join(t.TempDir(), "tokens"), now: time.Unix(1_800_000_000, 0), line: line}
	writeFile(t, b.path, line, 0o600)
	var err error
	if b.tokens, err = auth.OpenTokens(b.path); err != nil {
		t.Fatal(err)
	}
	if b.sessions, err = auth.NewSessions(b.tokens, make([]byte, 32), func() time.Time { return b.now }); err != nil {
		t.Fatal(err)
	}
	b.who, _ = b.tokens.Find(token)
	return b
}

func TestSessionsStandForTheirTokenUntilTheyEnd(t *testing.T) {
	b := newSessions(t)
	session := b.sessions.Open(b.who, time.Hour)
	who, found := b.sessions.Find(session)
	if !found || who.User != "alice" || who.Role != auth.Submit || !who.BySession {
		t.Errorf("found %v, %+v", found, who)
	}
	b.now = b.now.Add(time.Hour - time.Second)
	if _, found := b.sessions.Find(session); !found {
		t.Error("ended before its time")
	}
	b.now = b.now.Add(time.Second)
	if _, found := b.sessions.Find(session); found {
		t.Error("did not end")
	}
}

func TestSessionsEndWithTheirTokenAndFollowItsRole(t *testing.T) {
	b := newSessions(t)
	session := b.sessions.Open(b.who, time.Hour)
	writeFile(t, b.path, "read"+b.line[len("submit"):], 0o600)
	if err := b.tokens.Reload(); err != nil {
		t.Fatal(err)
	}
	if who, _ := b.sessions.Find(session); who.Role != auth.Read {
		t.Errorf("role %s after the token's became read", who.Role)
	}
	writeFile(t, b.path, "# gone\n", 0o600)
	if err := b.tokens.Reload(); err != nil {
		t.Fatal(err)
	}
	if _, found := b.sessions.Find(session); found {
		t.Error("the session outlived its token")
	}
}

func TestSessionsCannotBeMade(t *testing.T) {
	b := newSessions(t)
	session := b.sessions.Open(b.who, time.Hour)
	raw, err := base64.RawURLEncoding.DecodeString(session)
	if err != nil {
		t.Fatal(err)
	}
	for i := range raw {
		forged := bytes.Clone(raw)
		forged[i] ^= 1
		if _, found := b.sessions.Find(base64.RawURLEncoding.EncodeToString(forged)); found {
			t.Fatalf("byte %d does not matter", i)
		}
	}
	for _, wrong := range []string{"", "x", session + "AA", session[:len(session)-4]} {
		if _, found := b.sessions.Find(wrong); found {
			t.Errorf("%q is a session", wrong)
		}
	}
	other, err := auth.NewSessions(b.tokens, bytes.Repeat([]byte{1}, 32), func() time.Time { return b.now })
	if err != nil {
		t.Fatal(err)
	}
	if _, found := other.Find(session); found {
		t.Error("another key's signature is taken")
	}
	if _, err := auth.NewSessions(b.tokens, make([]byte, 31), time.Now); err == nil {
		t.Error("a short key is taken")
	}
}

func TestSessionKeyIsMadeOnce(t *testing.T) {
	path := filepath.Join(t.TempDir(), "key")
	first, err := auth.SessionKey(path)
	if err != nil {
		t.Fatal(err)
	}
	again, err := auth.SessionKey(path)
	if err != nil || !bytes.Equal(first, again) || len(first) < 32 {
		t.Errorf("%d bytes, then others: %v", len(first), err)
	}
	if info, err := os.Stat(path); err != nil || info.Mode().Perm() != 0o600 {
		t.Errorf("mode %v, error %v", info.Mode(), err)
	}
	if err := os.Chmod(path, 0o604); err != nil {
		t.Fatal(err)
	}
	if _, err := auth.SessionKey(path); err == nil {
		t.Error("a key that others read is taken")
	}
}
