package auth

import (
	"crypto/hmac"
	"crypto/rand"
	"crypto/sha256"
	"encoding/base64"
	"encoding/binary"
	"errors"
	"fmt"
	"io/fs"
	"os"
	"path/filepath"
	"time"
)

const sessionKeyBytes = 32

// A session is the hash of its token's hash, the time of its end and a signature over both. It
// needs no store, so that any coordinator with the same key takes it, and it ends with the token.
const (
	claimBytes   = sha256.Size + 8
	sessionBytes = claimBytes + sha256.Size
)

// Sessions makes and checks what browsers keep in a cookie.
type Sessions struct {
	tokens *Tokens
	key    []byte
	now    func() time.Time
}

// NewSessions signs with a key of at least 32 bytes. The sessions stand for tokens of tokens.
func NewSessions(tokens *Tokens, key []byte, now func() time.Time) (*Sessions, error) {
	if len(key) < sessionKeyBytes {
		return nil, fmt.Errorf("the session key has %d bytes; want at least %d", len(key), sessionKeyBytes)
	}
	return &Sessions{tokens: tokens, key: key, now: now}, nil
}

// Open returns a session that lasts for a time, for somebody who came with a token.
func (s *Sessions) Open(who Identity, lasts time.Duration) string {
	claim := who.claim()
	session := binary.BigEndian.AppendUint64(claim[:], uint64(s.now().Add(lasts).Unix()))
	return base64.RawURLEncoding.EncodeToString(append(session, s.sign(session)...))
}

// Find returns whose session it is.
func (s *Sessions) Find(text string) (Identity, bool) {
	session, err := base64.RawURLEncoding.DecodeString(text)
	if err != nil || len(session) != sessionBytes || !hmac.Equal(session[claimBytes:], s.sign(session[:claimBytes])) {
		return Identity{}, false
	}
	if end := binary.BigEndian.Uint64(session[sha256.Size:]); s.now().Unix() >= int64(end) {
		return Identity{}, false
	}
	who, found := s.tokens.byClaim(Hash(session[:sha256.Size]))
	who.BySession = found
	return who, found
}

func (s *Sessions) sign(claim []byte) []byte {
	mac := hmac.New(sha256.New, s.key)
	mac.Write([]byte("metrofarm session\n"))
	mac.Write(claim)
	return mac.Sum(nil)
}

// byClaim needs no constant time: the claim was signed by us.
func (t *Tokens) byClaim(claim Hash) (Identity, bool) {
	for _, entry := range *t.entries.Load() {
		if entry.claim() == claim {
			return entry, true
		}
	}
	return Identity{}, false
}

// SessionKey reads the key from a file, and makes the file where there is none.
func SessionKey(path string) ([]byte, error) {
	if err := makeKey(path); err != nil && !errors.Is(err, fs.ErrExist) {
		return nil, fmt.Errorf("session key: %w", err)
	}
	if err := CheckPrivate(path); err != nil {
		return nil, fmt.Errorf("session key: %w", err)
	}
	key, err := os.ReadFile(path)
	if err != nil {
		return nil, fmt.Errorf("session key: %w", err)
	}
	return key, nil
}

// makeKey makes the file in one step: another coordinator that shares the folder may look at it.
func makeKey(path string) error {
	if _, err := os.Lstat(path); err == nil {
		return fs.ErrExist
	}
	file, err := os.CreateTemp(filepath.Dir(path), ".session-key-*") // for its owner only
	if err != nil {
		return err
	}
	defer os.Remove(file.Name())
	key := make([]byte, sessionKeyBytes)
	_, _ = rand.Read(key) // never fails
	_, err = file.Write(key)
	if err := errors.Join(err, file.Close()); err != nil {
		return err
	}
	return os.Link(file.Name(), path)
}
