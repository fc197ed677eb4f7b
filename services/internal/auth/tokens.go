package auth

import (
	"crypto/rand"
	"crypto/sha256"
	"crypto/subtle"
	"encoding/base64"
	"encoding/hex"
	"errors"
	"fmt"
	"os"
	"regexp"
	"strings"
	"sync/atomic"
)

const (
	// tokenPrefix lets people and secret scanners tell what the text is.
	tokenPrefix = "mf_"
	tokenBytes  = 32
	// othersRead is the permission bit that a file of secrets must not have.
	othersRead = 0o004
)

var userPattern = regexp.MustCompile(`^[A-Za-z0-9][A-Za-z0-9._@-]{0,63}$`)

// Tokens are the tokens that a server accepts. Methods may be called from several goroutines.
type Tokens struct {
	path    string
	entries atomic.Pointer[[]Identity]
}

// OpenTokens reads a file of tokens. Each line has a role, a user's name and the SHA-256 of the
// token in hex; empty lines and those that start with # say nothing. Other users must not be able to
// read the file.
func OpenTokens(path string) (*Tokens, error) {
	t := &Tokens{path: path}
	if err := t.Reload(); err != nil {
		return nil, err
	}
	if len(*t.entries.Load()) == 0 {
		return nil, fmt.Errorf("tokens: %s has none; metrofarm token makes one", path)
	}
	return t, nil
}

// Path of the file.
func (t *Tokens) Path() string { return t.path }

// Reload reads the file again. On an error the tokens of before stay; a file without tokens lets
// nobody in.
func (t *Tokens) Reload() error {
	if err := CheckPrivate(t.path); err != nil {
		return err
	}
	content, err := os.ReadFile(t.path)
	if err != nil {
		return fmt.Errorf("tokens: %w", err)
	}
	entries, err := parseTokens(string(content))
	if err != nil {
		return fmt.Errorf("tokens: %s%w", t.path, err)
	}
	t.entries.Store(&entries)
	return nil
}

// CheckPrivate refuses a file that other users of this machine can read.
func CheckPrivate(path string) error {
	info, err := os.Stat(path)
	if err != nil {
		return err
	}
	if info.Mode().Perm()&othersRead != 0 {
		return fmt.Errorf("%s: other users can read it (mode %04o); chmod o-rwx %s", path, info.Mode().Perm(), path)
	}
	return nil
}

// parseTokens returns errors that start with a colon and the line number.
func parseTokens(content string) ([]Identity, error) {
	var entries []Identity
	seen := make(map[Hash]int)
	for i, line := range strings.Split(content, "\n") {
		fields := strings.Fields(line)
		if len(fields) == 0 || strings.HasPrefix(fields[0], "#") {
			continue
		}
		entry, err := parseEntry(fields)
		if err != nil {
			return nil, fmt.Errorf(":%d: %w", i+1, err)
		}
		if first := seen[entry.token]; first > 0 {
			return nil, fmt.Errorf(":%d: the same token as in line %d", i+1, first)
		}
		seen[entry.token] = i + 1
		entries = append(entries, entry)
	}
	return entries, nil
}

func parseEntry(fields []string) (Identity, error) {
	if len(fields) != 3 {
		return Identity{}, errors.New("want ROLE USER SHA256")
	}
	role, err := ParseRole(fields[0])
	if err != nil {
		return Identity{}, err
	}
	if err := checkUser(fields[1]); err != nil {
		return Identity{}, err
	}
	entry := Identity{Role: role, User: fields[1]}
	hash, err := hex.DecodeString(fields[2])
	if err != nil || copy(entry.token[:], hash) != sha256.Size || len(hash) != sha256.Size {
		// Not quoted: somebody may have put the token itself here.
		return Identity{}, errors.New("the third word is no SHA-256 in hex")
	}
	return entry, nil
}

func checkUser(name string) error {
	if !userPattern.MatchString(name) {
		return fmt.Errorf("user %q: want up to 64 letters, digits and . _ @ -, a letter or digit first", name)
	}
	return nil
}

// Find returns who has a token. The time that it takes does not depend on how much of the token is
// right, nor on whose it is.
func (t *Tokens) Find(token string) (Identity, bool) {
	return t.find(sha256.Sum256([]byte(token)))
}

func (t *Tokens) find(hash Hash) (Identity, bool) {
	var found Identity
	matches := 0
	for _, entry := range *t.entries.Load() {
		if subtle.ConstantTimeCompare(entry.token[:], hash[:]) == 1 {
			found = entry
			matches++
		}
	}
	return found, matches > 0
}

// NewToken makes a token, and the line of the file that allows it.
func NewToken(role Role, user string) (token, line string, err error) {
	if err := checkUser(user); err != nil {
		return "", "", err
	}
	var secret [tokenBytes]byte
	_, _ = rand.Read(secret[:]) // never fails
	token = tokenPrefix + base64.RawURLEncoding.EncodeToString(secret[:])
	hash := sha256.Sum256([]byte(token))
	return token, fmt.Sprintf("%s %s %s", role, user, hex.EncodeToString(hash[:])), nil
}
