package client_test

import (
	"crypto/tls"
	"net/http"
	"net/http/httptest"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/client"
	"metrofarm/services/internal/tlsconf"
)

func TestTheTokenTravelsInTheHeaderOnly(t *testing.T) {
	var seen []*http.Request
	server := httptest.NewServer(http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		seen = append(seen, r)
		http.Redirect(w, r, "http://elsewhere.example/", http.StatusTemporaryRedirect)
	}))
	defer server.Close()
	for _, token := range []string{"", "mf_secret"} {
		c, err := client.New(server.URL, client.Options{Token: token})
		if err != nil {
			t.Fatal(err)
		}
		_, err = c.Job(t.Context(), "x")
		if err == nil || strings.Contains(err.Error(), "secret") {
			t.Errorf("error %v, want one without the token", err)
		}
	}
	if len(seen) != 2 || seen[0].Header.Get("Authorization") != "" || seen[1].Header.Get("Authorization") != "Bearer mf_secret" ||
		strings.Contains(seen[1].URL.String(), "secret") {
		t.Errorf("requests %v", seen)
	}
}

func TestOnlyTheGivenAuthorityIsTrusted(t *testing.T) {
	ours, foreign := t.TempDir(), t.TempDir()
	for _, dir := range []string{ours, foreign} {
		if err := tlsconf.Generate(dir, []string{"127.0.0.1"}, time.Now()); err != nil {
			t.Fatal(err)
		}
	}
	secure, err := tlsconf.Open(tlsconf.Files{Certificate: ours + "/server.crt", Key: ours + "/server.key"})
	if err != nil {
		t.Fatal(err)
	}
	server := httptest.NewUnstartedServer(http.HandlerFunc(func(w http.ResponseWriter, _ *http.Request) {
		_, _ = w.Write([]byte(`{"workers":[]}`))
	}))
	server.Listener = tls.NewListener(server.Listener, secure.Config())
	server.Start()
	defer server.Close()
	for dir, works := range map[string]bool{ours: true, foreign: false, "": false} {
		var options client.Options
		if dir != "" {
			if options.TLS, err = tlsconf.Client(dir + "/ca.crt"); err != nil {
				t.Fatal(err)
			}
		}
		c, err := client.New("https://"+server.Listener.Addr().String(), options)
		if err != nil {
			t.Fatal(err)
		}
		if _, err := c.Workers(t.Context()); (err == nil) != works {
			t.Errorf("trusting %q: %v", dir, err)
		}
	}
}
