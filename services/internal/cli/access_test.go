package cli

import (
	"net/http"
	"net/http/httptest"
	"os"
	"path/filepath"
	"strings"
	"testing"

	"metrofarm/services/internal/auth"
)

func (b *bench) write(t *testing.T, name, content string, mode os.FileMode) string {
	t.Helper()
	path := b.path(name)
	if err := os.WriteFile(path, []byte(content), mode); err != nil {
		t.Fatal(err)
	}
	return path
}

// secrets makes a file of tokens and a folder of certificates with the commands that users have.
func (b *bench) secrets(t *testing.T) (token, tokens, certificates string) {
	t.Helper()
	b.stdout.Reset()
	if code := b.run(t, "token", "admin", "root"); code != 0 {
		t.Fatal(b.stderr.String())
	}
	token, line, _ := strings.Cut(strings.TrimSpace(b.stdout.String()), "\n")
	tokens = b.write(t, "tokens", line+"\n", 0o600)
	certificates = b.path("certs")
	if code := b.run(t, "certs", certificates, "--host", "farm.example"); code != 0 {
		t.Fatal(b.stderr.String())
	}
	return token, tokens, certificates
}

func TestServeOpensToOthersOnlyWithTokensAndCertificates(t *testing.T) {
	b := newBench(t, listsScene)
	_, tokens, certs := b.secrets(t)
	const rest, farm, wide = "needs --tokens", "needs --farm-tls-cert, --farm-tls-key and --farm-tls-ca", "0.0.0.0:1"
	mutual := []string{"--farm-tls-cert", certs + "/server.crt", "--farm-tls-key", certs + "/server.key", "--farm-tls-ca", certs + "/ca.crt"}
	cases := []struct {
		name      string
		arguments []string
		want      []string // in the error; none: it starts
	}{
		{"default", nil, nil},
		{"loopback", []string{"--listen", "[::1]:1", "--farm-listen", "localhost:1"}, nil},
		{"both wide", []string{"--listen", wide, "--farm-listen", ":1"}, []string{rest, farm}},
		{"a name", []string{"--listen", "farm.example:1"}, []string{rest}},
		{"certificate is no token", []string{"--listen", wide, "--tls-cert", certs + "/server.crt", "--tls-key", certs + "/server.key"}, []string{rest}},
		{"token is no certificate", []string{"--listen", wide, "--farm-listen", wide, "--tokens", tokens}, []string{farm}},
		{"tokens", []string{"--listen", wide, "--tokens", tokens}, nil},
		{"mutual", append([]string{"--farm-listen", wide}, mutual...), nil},
		{"no authority", append([]string{"--farm-listen", wide}, mutual[:4]...), []string{"belong together"}},
		{"key alone", []string{"--tls-key", certs + "/server.key"}, []string{"--tls-cert and --tls-key belong together"}},
		{"insecure", []string{"--listen", wide, "--farm-listen", wide, "--insecure"}, nil},
		{"rate", []string{"--max-rate", "0"}, []string{"--max-rate"}},
		{"streams", []string{"--max-streams", "0"}, []string{"--max-streams"}},
		{"jobs", []string{"--max-jobs", "0"}, []string{"--max-jobs"}},
		{"jobs of a user", []string{"--max-user-jobs", "-1"}, []string{"--max-user-jobs"}},
		{"memory", []string{"--max-memory", "18446744073709551615"}, []string{"--max-memory"}},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			b.stderr.Reset()
			b.farm.options = FarmOptions{}
			go func() { b.interrupts <- os.Interrupt }()
			code := b.run(t, append([]string{"serve", "--data", b.path("data"), "--workers", "0"}, c.arguments...)...)
			if started := code == 0; started != (len(c.want) == 0) {
				t.Errorf("exit code %d: %s", code, b.stderr.String())
			}
			if len(c.want) > 0 {
				<-b.interrupts // nobody took it
			}
			for _, want := range c.want {
				if !strings.Contains(b.stderr.String(), want) {
					t.Errorf("%q does not say %q", b.stderr.String(), want)
				}
			}
		})
	}
}

func TestServePassesItsAccessOn(t *testing.T) {
	b := newBench(t, listsScene)
	token, tokens, certs := b.secrets(t)
	go func() { b.interrupts <- os.Interrupt }()
	code := b.run(t, "serve", "--data", b.path("data"), "--workers", "0", "--tokens", tokens, "--tls-cert", certs+"/server.crt",
		"--tls-key", certs+"/server.key", "--host", "a", "--host", "b", "--max-rate", "7", "--max-user-jobs", "5", "--max-pixels", "9", "--max-memory", "3",
		"--open-metrics", "--session-time", "1h")
	if code != 0 {
		t.Fatal(b.stderr.String())
	}
	a := b.farm.options.Access
	if who, found := a.Tokens.Find(token); !found || who.User != "root" || who.Role != auth.Admin {
		t.Errorf("token of %+v", who)
	}
	if a.TLS == nil || a.FarmTLS != nil || strings.Join(a.Hosts, " ") != "a b" || a.Limits.RequestsPerSecond != 7 ||
		a.Limits.Uploads == 0 || a.JobLimits.Pixels != 9 || a.MaxJobs != 20000 || a.MaxUserJobs != 5 || a.JobLimits.CoordinatorBytes != 3<<20 || a.JobLimits.Chains == 0 ||
		!a.OpenMetrics || a.SessionTime.Hours() != 1 || len(a.SessionKey) < 32 {
		t.Errorf("access %+v", a)
	}
	if info, err := os.Stat(filepath.Join(b.path("data"), "session.key")); err != nil || info.Mode().Perm() != 0o600 {
		t.Errorf("session key: %v, error %v", info, err)
	}
	if strings.Contains(b.stderr.String(), token) {
		t.Error("the token is in the log")
	}
}

func TestServeRefusesFilesThatOthersRead(t *testing.T) {
	b := newBench(t, listsScene)
	_, tokens, _ := b.secrets(t)
	if err := os.Chmod(tokens, 0o644); err != nil {
		t.Fatal(err)
	}
	code := b.run(t, "serve", "--data", b.path("data"), "--workers", "0", "--tokens", tokens)
	if code != 1 || !strings.Contains(b.stderr.String(), "chmod o-rwx") {
		t.Errorf("exit code %d: %s", code, b.stderr.String())
	}
}

func TestCommandsBringTheirToken(t *testing.T) {
	got := ""
	server := httptest.NewServer(http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		got = r.Header.Get("Authorization")
		_, _ = w.Write([]byte(`{"workers":[]}`))
	}))
	defer server.Close()
	b := newBench(t, listsScene)
	environment := map[string]string{}
	b.env.Getenv = func(name string) string { return environment[name] }
	expect := func(want string, arguments ...string) {
		t.Helper()
		got = ""
		if code := b.run(t, append([]string{"workers", "--server", server.URL}, arguments...)...); code != 0 || got != want {
			t.Errorf("exit code %d, %q, want %q: %s", code, got, want, b.stderr.String())
		}
	}
	expect("")
	environment["METROFARM_TOKEN"] = "mf_environment\n"
	expect("Bearer mf_environment")
	// As metrofarm token wrote it.
	expect("Bearer mf_file", "--token-file", b.write(t, "mine", "mf_file\nadmin root 00\n", 0o600))
	for name, arguments := range map[string][]string{
		"other users can read": {"--token-file", b.write(t, "open", "mf_file", 0o604)},
		"no such file":         {"--token-file", b.path("none")},
		"--ca":                 {"--ca", b.path("mine")},
		"not defined: -token":  {"--token", "mf_file"},
	} {
		b.stderr.Reset()
		if code := b.run(t, append([]string{"workers", "--server", server.URL}, arguments...)...); code == 0 || !strings.Contains(b.stderr.String(), name) {
			t.Errorf("%v: exit code %d: %s", arguments, code, b.stderr.String())
		}
	}
}

func TestTokenCommand(t *testing.T) {
	b := newBench(t, listsScene)
	for want, arguments := range map[string][]string{
		`role "root"`: {"token", "root", "me"}, `user "a b"`: {"token", "read", "a b"}, "usage": {"token", "read"},
	} {
		b.stderr.Reset()
		if code := b.run(t, arguments...); code != 2 || !strings.Contains(b.stderr.String(), want) {
			t.Errorf("%v: exit code %d: %s", arguments, code, b.stderr.String())
		}
	}
	if b.stdout.Len() != 0 {
		t.Errorf("a token nevertheless: %s", b.stdout.String())
	}
}
