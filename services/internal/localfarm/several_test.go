package localfarm_test

import (
	"encoding/json"
	"io"
	"net/http"
	"os"
	"path/filepath"
	"testing"

	"github.com/alicebob/miniredis/v2"

	"metrofarm/services/internal/bundle"
	"metrofarm/services/internal/cli"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/localfarm"
	"metrofarm/services/internal/tlsconf"
)

// TestSeveralShareAStore starts two coordinators on one Redis store and one folder, as two processes
// would, and asks the one about a job of the other.
func TestSeveralShareAStore(t *testing.T) {
	testSeveralShareAStore(t, options(t), http.DefaultClient)
}

// TestSeveralSpeakTLS: they trust each other by the authority that they are given.
func TestSeveralSpeakTLS(t *testing.T) {
	dir := certificates(t)
	trusting, err := tlsconf.Client(filepath.Join(dir, "ca.crt"))
	if err != nil {
		t.Fatal(err)
	}
	o := options(t)
	o.Access = cli.Access{TLS: openTLS(t, dir, ""), PeerTLS: trusting}
	testSeveralShareAStore(t, o, &http.Client{Transport: &http.Transport{TLSClientConfig: trusting}})
}

func testSeveralShareAStore(t *testing.T, o cli.FarmOptions, client *http.Client) {
	t.Helper()
	o.Store = "redis://" + miniredis.RunT(t).Addr() + "/0"
	var farms [2]*localfarm.Farm
	for i := range farms {
		farm, err := localfarm.Start(t.Context(), o)
		if err != nil {
			t.Fatal(err)
		}
		defer farm.Close()
		farms[i] = farm
	}
	scene := filepath.Join(t.TempDir(), "scene.xml")
	if err := os.WriteFile(scene, []byte("<scene/>"), 0o600); err != nil {
		t.Fatal(err)
	}
	stored, err := farms[0].AddScene(t.Context(), bundle.Local{Root: filepath.Dir(scene), Entry: "scene.xml", Paths: []string{"scene.xml"}})
	if err != nil {
		t.Fatal(err)
	}
	submitted, err := farms[0].Service().Submit(t.Context(), job.Request{Scene: stored.Digest, Entry: "scene.xml"}, "key")
	if err != nil {
		t.Fatal(err)
	}
	again, err := farms[1].Service().Submit(t.Context(), job.Request{Scene: stored.Digest, Entry: "scene.xml"}, "key")
	if err != nil || again.ID != submitted.ID {
		t.Errorf("with the same key: %s, not %s, error %v", again.ID, submitted.ID, err)
	}
	response, err := client.Post(farms[1].Dashboard()+"v1/jobs/"+submitted.ID+"/pause", "", nil)
	if err != nil {
		t.Fatal(err)
	}
	defer response.Body.Close()
	var paused job.Snapshot
	body, _ := io.ReadAll(response.Body)
	if err := json.Unmarshal(body, &paused); err != nil || !paused.Paused || paused.Stale {
		t.Errorf("%s: %s", response.Status, body)
	}
	jobs, _, err := farms[1].Service().Jobs(t.Context(), "", 10)
	if err != nil || len(jobs) != 1 || jobs[0].Stale || !jobs[0].Paused {
		t.Errorf("jobs %+v, error %v", jobs, err)
	}
}
