package auth_test

import (
	"os"
	"path/filepath"
	"strings"
	"testing"

	"metrofarm/services/internal/auth"
)

func writeFile(t *testing.T, path, content string, mode os.FileMode) {
	t.Helper()
	if err := os.WriteFile(path, []byte(content), mode); err != nil {
		t.Fatal(err)
	}
	if err := os.Chmod(path, mode); err != nil { // WriteFile leaves the mode of what exists
		t.Fatal(err)
	}
}

func newToken(t *testing.T, role auth.Role, user string) (token, line string) {
	t.Helper()
	token, line, err := auth.NewToken(role, user)
	if err != nil {
		t.Fatal(err)
	}
	return token, line
}

func TestTokensAreFoundByTheirText(t *testing.T) {
	alice, first := newToken(t, auth.Submit, "alice")
	bob, second := newToken(t, auth.Read, "bob@example.org")
	path := filepath.Join(t.TempDir(), "tokens")
	writeFile(t, path, "# people\n\n"+first+"\r\n\t"+second+"\n", 0o640)
	tokens, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	for token, want := range map[string]string{alice: "alice submit", bob: "bob@example.org read"} {
		who, found := tokens.Find(token)
		if got := who.User + " " + who.Role.String(); !found || got != want {
			t.Errorf("found %v %q, want %q", found, got, want)
		}
	}
	for _, wrong := range []string{"", alice + "x", alice[:len(alice)-1], strings.ToLower(alice), strings.Fields(first)[2], "alice"} {
		if who, found := tokens.Find(wrong); found || who.Role != auth.None {
			t.Errorf("%q is taken for %+v", wrong, who)
		}
	}
	if alice == bob || len(alice) < 43 {
		t.Errorf("tokens %s and %s", alice, bob)
	}
}

func TestTokenFilesAreChecked(t *testing.T) {
	token, line := newToken(t, auth.Admin, "root")
	hash := strings.Fields(line)[2]
	cases := []struct {
		name, content string
		mode          os.FileMode
		want          string
	}{
		{"readable by others", line, 0o644, "other users can read it"},
		{"empty", "# nobody\n", 0o600, "has none"},
		{"role", "# x\nroot me " + hash, 0o600, `:2: role "root": want read, submit or admin`},
		{"none is no role", "none me " + hash, 0o600, `role "none"`},
		{"user", "read a/b " + hash, 0o600, `user "a/b"`},
		{"words", "read me", 0o600, "want ROLE USER SHA256"},
		{"more words", line + " x", 0o600, "want ROLE USER SHA256"},
		{"short hash", "read me " + hash[2:], 0o600, "no SHA-256"},
		{"long hash", "read me " + hash + "00", 0o600, "no SHA-256"},
		{"the token itself", "read me " + token, 0o600, "no SHA-256"},
		{"twice", line + "\nread me " + hash, 0o600, ":2: the same token as in line 1"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			path := filepath.Join(t.TempDir(), "tokens")
			writeFile(t, path, c.content, c.mode)
			_, err := auth.OpenTokens(path)
			if err == nil || !strings.Contains(err.Error(), c.want) || strings.Contains(err.Error(), token) {
				t.Errorf("error %v, want %q and not the token", err, c.want)
			}
		})
	}
	if _, err := auth.OpenTokens(filepath.Join(t.TempDir(), "none")); err == nil {
		t.Error("a file that is not there was read")
	}
}

func TestReloadTakesAndWithdrawsTokens(t *testing.T) {
	alice, first := newToken(t, auth.Submit, "alice")
	bob, second := newToken(t, auth.Read, "bob")
	path := filepath.Join(t.TempDir(), "tokens")
	writeFile(t, path, first, 0o600)
	tokens, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	expect := func(wantAlice, wantBob bool) {
		t.Helper()
		_, gotAlice := tokens.Find(alice)
		_, gotBob := tokens.Find(bob)
		if gotAlice != wantAlice || gotBob != wantBob {
			t.Errorf("alice %v, bob %v, want %v, %v", gotAlice, gotBob, wantAlice, wantBob)
		}
	}
	writeFile(t, path, second, 0o600)
	if err := tokens.Reload(); err != nil {
		t.Fatal(err)
	}
	expect(false, true)
	writeFile(t, path, "nonsense", 0o600)
	if tokens.Reload() == nil {
		t.Error("nonsense was read")
	}
	expect(false, true)
	writeFile(t, path, "# nobody any more\n", 0o600)
	if err := tokens.Reload(); err != nil {
		t.Fatal(err)
	}
	expect(false, false)
}

func TestNewTokenRefusesNames(t *testing.T) {
	for _, name := range []string{"", "a b", "-a", "a\nadmin b", strings.Repeat("a", 65), "ä"} {
		if _, _, err := auth.NewToken(auth.Read, name); err == nil {
			t.Errorf("%q became a user", name)
		}
	}
}

func TestRolesIncludeEachOther(t *testing.T) {
	roles := []auth.Role{auth.None, auth.Read, auth.Submit, auth.Admin}
	for i, a := range roles {
		for j, b := range roles {
			if a.Includes(b) != (i >= j) {
				t.Errorf("%s includes %s: %v", a, b, a.Includes(b))
			}
		}
	}
}
