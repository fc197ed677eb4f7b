package localfarm_test

import (
	"context"
	"crypto/tls"
	"net"
	"net/http"
	"os"
	"path/filepath"
	"strings"
	"testing"
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/codes"
	"google.golang.org/grpc/credentials"
	"google.golang.org/grpc/credentials/insecure"
	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
	"metrofarm/services/internal/localfarm"
	"metrofarm/services/internal/tlsconf"
)

// certificates made for this machine.
func certificates(t *testing.T) string {
	t.Helper()
	dir := t.TempDir()
	if err := tlsconf.Generate(dir, []string{"127.0.0.1"}, time.Now()); err != nil {
		t.Fatal(err)
	}
	return dir
}

func openTLS(t *testing.T, dir, ca string) *tlsconf.Server {
	t.Helper()
	server, err := tlsconf.Open(tlsconf.Files{Certificate: dir + "/server.crt", Key: dir + "/server.key", ClientCA: ca})
	if err != nil {
		t.Fatal(err)
	}
	return server
}

func clientTLS(t *testing.T, dir string) *tls.Config {
	t.Helper()
	config, err := tlsconf.Client(dir + "/ca.crt")
	if err != nil {
		t.Fatal(err)
	}
	return config
}

// freeAddress for a listener whose address the test has to know.
func freeAddress(t *testing.T) string {
	t.Helper()
	listener, err := net.Listen("tcp", "127.0.0.1:0")
	if err != nil {
		t.Fatal(err)
	}
	defer listener.Close()
	return listener.Addr().String()
}

func dial(t *testing.T, address string, secure credentials.TransportCredentials) farmv1.FarmServiceClient {
	t.Helper()
	connection, err := grpc.NewClient(address, grpc.WithTransportCredentials(secure))
	if err != nil {
		t.Fatal(err)
	}
	t.Cleanup(func() { connection.Close() })
	return farmv1.NewFarmServiceClient(connection)
}

func register(ctx context.Context, worker farmv1.FarmServiceClient) (string, error) {
	answer, err := worker.Register(ctx, &farmv1.RegisterRequest{Name: "w", Version: "v", Threads: 1, Instance: strings.Repeat("a", 32)})
	return answer.GetWorkerId(), err
}

func TestRESTSpeaksHTTP2UnderTLS(t *testing.T) {
	dir, o := certificates(t), options(t)
	o.Access.TLS = openTLS(t, dir, "")
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	defer farm.Close()
	browser := &http.Client{Transport: &http.Transport{TLSClientConfig: clientTLS(t, dir), ForceAttemptHTTP2: true}}
	defer browser.CloseIdleConnections()
	response, err := browser.Get(farm.Dashboard() + "v1/jobs")
	if err != nil {
		t.Fatal(err)
	}
	response.Body.Close()
	if response.StatusCode != http.StatusOK || response.ProtoMajor != 2 || !strings.HasPrefix(farm.Dashboard(), "https://") {
		t.Errorf("%s by %s from %s", response.Status, response.Proto, farm.Dashboard())
	}
	plain, err := http.Get(strings.Replace(farm.Dashboard(), "https", "http", 1))
	if err == nil {
		plain.Body.Close()
		if plain.StatusCode != http.StatusBadRequest {
			t.Errorf("without TLS: %s", plain.Status)
		}
	}
}

func TestWorkersNeedCertificatesAndLocalOnesDoNot(t *testing.T) {
	dir, o := certificates(t), options(t)
	o.FarmListen, o.Access.FarmTLS = freeAddress(t), openTLS(t, dir, dir+"/ca.crt")
	said := filepath.Join(t.TempDir(), "arguments")
	o.Workers, o.WorkerProgram = 1, filepath.Join(t.TempDir(), "worker")
	script := "#!/bin/sh\necho \"$2\" > " + said + ".part\nmv " + said + ".part " + said + "\nexec sleep 100\n"
	if err := os.WriteFile(o.WorkerProgram, []byte(script), 0o700); err != nil {
		t.Fatal(err)
	}
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	defer farm.Close()
	ctx, cancel := context.WithTimeout(t.Context(), 20*time.Second)
	defer cancel()
	shown := clientTLS(t, dir)
	pair, err := tls.LoadX509KeyPair(dir+"/worker.crt", dir+"/worker.key")
	if err != nil {
		t.Fatal(err)
	}
	shown.Certificates = []tls.Certificate{pair}
	if _, err := register(ctx, dial(t, o.FarmListen, credentials.NewTLS(shown))); err != nil {
		t.Errorf("with a certificate: %v", err)
	}
	for name, secure := range map[string]credentials.TransportCredentials{
		"TLS without a certificate": credentials.NewTLS(clientTLS(t, dir)), "no TLS": insecure.NewCredentials(),
	} {
		if _, err := register(ctx, dial(t, o.FarmListen, secure)); status.Code(err) != codes.Unavailable {
			t.Errorf("%s: %v", name, err)
		}
	}
	var local []byte
	for len(local) == 0 && ctx.Err() == nil {
		local, _ = os.ReadFile(said)
		time.Sleep(10 * time.Millisecond)
	}
	address := strings.TrimSpace(string(local))
	if address == o.FarmListen || !strings.HasPrefix(address, "127.0.0.1:") {
		t.Fatalf("the local worker was sent to %q", address)
	}
	if _, err := register(ctx, dial(t, address, insecure.NewCredentials())); err != nil {
		t.Errorf("local: %v", err)
	}
}

func TestAConnectionHasSoManyStreams(t *testing.T) {
	o := options(t)
	o.FarmListen = freeAddress(t)
	farm, err := localfarm.Start(t.Context(), o)
	if err != nil {
		t.Fatal(err)
	}
	defer farm.Close()
	ctx, cancel := context.WithCancel(t.Context())
	defer cancel()
	worker := dial(t, o.FarmListen, insecure.NewCredentials())
	id, err := register(ctx, worker)
	if err != nil {
		t.Fatal(err)
	}
	const enough, tooMany = 16, 100
	for range enough {
		go func() { _, _ = worker.Lease(ctx, &farmv1.LeaseRequest{WorkerId: id, MaxSegments: 1, WaitSeconds: 30}) }()
	}
	within := func(patience time.Duration) error {
		short, end := context.WithTimeout(ctx, patience)
		defer end()
		_, err := worker.Heartbeat(short, &farmv1.HeartbeatRequest{WorkerId: id})
		return err
	}
	if err := within(time.Minute); err != nil {
		t.Errorf("a worker's own streams are too many: %v", err)
	}
	for range tooMany {
		go func() { _, _ = worker.Lease(ctx, &farmv1.LeaseRequest{WorkerId: id, MaxSegments: 1, WaitSeconds: 30}) }()
	}
	for deadline := time.Now().Add(20 * time.Second); status.Code(within(2*time.Second)) != codes.DeadlineExceeded; {
		if time.Now().After(deadline) {
			t.Fatal("a hundred streams at a time are served")
		}
	}
}
