package tlsconf_test

import (
	"crypto/tls"
	"errors"
	"io"
	"io/fs"
	"net"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"metrofarm/services/internal/tlsconf"
)

// generate makes a folder of certificates.
func generate(t *testing.T, now time.Time) string {
	t.Helper()
	dir := t.TempDir()
	if err := tlsconf.Generate(dir, []string{"farm.example", "127.0.0.1"}, now); err != nil {
		t.Fatal(err)
	}
	return dir
}

func serverFiles(dir string) tlsconf.Files {
	return tlsconf.Files{Certificate: dir + "/server.crt", Key: dir + "/server.key", ClientCA: dir + "/ca.crt"}
}

func open(t *testing.T, files tlsconf.Files) *tlsconf.Server {
	t.Helper()
	server, err := tlsconf.Open(files)
	if err != nil {
		t.Fatal(err)
	}
	return server
}

// clientConfig trusts the authority of one folder and shows a certificate of another; "": none.
func clientConfig(t *testing.T, trusts, shows, name string) *tls.Config {
	t.Helper()
	config, err := tlsconf.Client(trusts + "/ca.crt")
	if err != nil {
		t.Fatal(err)
	}
	config.ServerName = "farm.example"
	if shows != "" {
		pair, err := tls.LoadX509KeyPair(filepath.Join(shows, name+".crt"), filepath.Join(shows, name+".key"))
		if err != nil {
			t.Fatal(err)
		}
		// Shown even where the server does not ask for its authority.
		config.GetClientCertificate = func(*tls.CertificateRequestInfo) (*tls.Certificate, error) { return &pair, nil }
	}
	return config
}

// handshake returns the client's error, or else that of the server, which the client sees on its
// first read.
func handshake(t *testing.T, server *tlsconf.Server, client *tls.Config) (serial string, err error) {
	t.Helper()
	ours, theirs := net.Pipe()
	defer theirs.Close()
	failed := make(chan error, 1)
	go func() {
		defer ours.Close()
		connection := tls.Server(ours, server.Config())
		err := connection.Handshake()
		if err == nil {
			_, err = io.WriteString(connection, "hello")
		}
		failed <- err
	}()
	connection := tls.Client(theirs, client)
	if err := connection.Handshake(); err != nil {
		return "", err
	}
	_, err = io.ReadFull(connection, make([]byte, 5))
	return connection.ConnectionState().PeerCertificates[0].SerialNumber.String(), errors.Join(err, <-failed)
}

func TestOnlyOurWorkersGetIn(t *testing.T) {
	ours, foreign, past := generate(t, time.Now()), generate(t, time.Now()), generate(t, time.Now().AddDate(-2, 0, 0))
	mixed := serverFiles(ours)
	pastCA := serverFiles(ours)
	pastCA.ClientCA = past + "/ca.crt"
	cases := []struct {
		name   string
		files  tlsconf.Files
		client *tls.Config
		want   string // part of the error; empty: it works
	}{
		{"worker", mixed, clientConfig(t, ours, ours, "worker"), ""},
		{"no certificate", mixed, clientConfig(t, ours, "", ""), "certificate required"},
		{"another authority's worker", mixed, clientConfig(t, ours, foreign, "worker"), "unknown certificate authority"},
		{"a server's certificate", mixed, clientConfig(t, ours, ours, "server"), "bad certificate"},
		{"ended", pastCA, clientConfig(t, ours, past, "worker"), "expired"},
		{"worker does not know us", mixed, clientConfig(t, foreign, ours, "worker"), "signed by unknown authority"},
	}
	for _, c := range cases {
		t.Run(c.name, func(t *testing.T) {
			_, err := handshake(t, open(t, c.files), c.client)
			if (c.want == "") != (err == nil) || (err != nil && !strings.Contains(err.Error(), c.want)) {
				t.Errorf("error %v, want %q", err, c.want)
			}
		})
	}
	old := clientConfig(t, ours, ours, "worker")
	old.MinVersion, old.MaxVersion = tls.VersionTLS12, tls.VersionTLS12
	if _, err := handshake(t, open(t, mixed), old); err == nil || !strings.Contains(err.Error(), "protocol version") {
		t.Errorf("TLS 1.2: error %v", err)
	}
	wrongName := clientConfig(t, ours, ours, "worker")
	wrongName.ServerName = "other.example"
	if _, err := handshake(t, open(t, mixed), wrongName); err == nil || !strings.Contains(err.Error(), "not other.example") {
		t.Errorf("another name: error %v", err)
	}
}

func TestWithoutAuthorityClientsNeedNoCertificate(t *testing.T) {
	dir := generate(t, time.Now())
	files := serverFiles(dir)
	files.ClientCA = ""
	if _, err := handshake(t, open(t, files), clientConfig(t, dir, "", "")); err != nil {
		t.Error(err)
	}
}

func TestReplacedFilesAreUsedAndBrokenOnesAreNot(t *testing.T) {
	first, second := generate(t, time.Now()), generate(t, time.Now())
	server := open(t, serverFiles(first))
	before, err := handshake(t, server, clientConfig(t, first, first, "worker"))
	if err != nil {
		t.Fatal(err)
	}
	old := clientConfig(t, first, first, "worker")
	for _, name := range []string{"server.crt", "server.key", "ca.crt"} {
		if err := os.Rename(filepath.Join(second, name), filepath.Join(first, name)); err != nil {
			t.Fatal(err)
		}
	}
	if err := server.Reload(); err != nil {
		t.Fatal(err)
	}
	after, err := handshake(t, server, clientConfig(t, first, second, "worker"))
	if err != nil || after == before {
		t.Errorf("certificate %s after %s, error %v", after, before, err)
	}
	old.InsecureSkipVerify = true // is it the server that refuses?
	if _, err := handshake(t, server, old); err == nil {
		t.Error("a worker of the authority of before gets in")
	}
	if err := os.WriteFile(filepath.Join(first, "server.crt"), []byte("half a file"), 0o600); err != nil {
		t.Fatal(err)
	}
	if server.Reload() == nil {
		t.Error("half a file was read")
	}
	if again, err := handshake(t, server, clientConfig(t, first, second, "worker")); err != nil || again != after {
		t.Errorf("certificate %s after a broken file, error %v", again, err)
	}
}

func TestOpenSaysWhatIsWrong(t *testing.T) {
	dir, past := generate(t, time.Now()), generate(t, time.Now().AddDate(-2, 0, 0))
	good := serverFiles(dir)
	readable := generate(t, time.Now())
	if err := os.Chmod(readable+"/server.key", 0o644); err != nil {
		t.Fatal(err)
	}
	cases := map[string]tlsconf.Files{
		"other users can read it": serverFiles(readable),
		"private key does not":    {Certificate: good.Certificate, Key: dir + "/worker.key"},
		"ended at":                serverFiles(past),
		"no certificate in PEM":   {Certificate: good.Certificate, Key: good.Key, ClientCA: good.Key},
		"no such file":            {Certificate: dir + "/none.crt", Key: good.Key},
	}
	for want, files := range cases {
		if _, err := tlsconf.Open(files); err == nil || !strings.Contains(err.Error(), want) {
			t.Errorf("%+v: error %v, want %q", files, err, want)
		}
	}
}

func TestGenerateKeepsKeysPrivateAndReplacesNothing(t *testing.T) {
	dir := generate(t, time.Now())
	for _, name := range []string{"ca.key", "server.key", "worker.key"} {
		if info, err := os.Stat(filepath.Join(dir, name)); err != nil || info.Mode().Perm() != 0o600 {
			t.Errorf("%s: mode %v, error %v", name, info.Mode(), err)
		}
	}
	if err := os.Remove(filepath.Join(dir, "ca.key")); err != nil {
		t.Fatal(err)
	}
	if tlsconf.Generate(dir, nil, time.Now()) == nil {
		t.Error("files were replaced")
	}
	if _, err := os.Stat(filepath.Join(dir, "ca.key")); !errors.Is(err, fs.ErrNotExist) {
		t.Error("half a set was made")
	}
}
