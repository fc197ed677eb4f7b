package api_test

import (
	"bytes"
	"image/png"
	"strings"
	"testing"

	"github.com/klauspost/compress/gzip"

	"metrofarm/services/internal/job"
)

func TestFloatMaps(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	path := "/v1/jobs/" + id + "/image.pfm"
	f.expectProblem(409, "", f.do("GET", path, ""))
	f.round(id, 1)
	plain := f.expect(200, "GET", path, "", "Accept-Encoding", "identity")
	const head = "PF\n2 1\n-1.0\n"
	if !strings.HasPrefix(string(plain.body), head+"\x00\x00\x80\x3f\x00\x00\x00\x3f") || len(plain.body) != len(head)+24 {
		t.Errorf("%q", plain.body)
	}
	zipped := f.expect(200, "GET", path, "", "Accept-Encoding", "gzip")
	if zipped.header.Get("Content-Encoding") != "gzip" || zipped.header.Get("ETag") != `"f"` {
		t.Errorf("headers %v", zipped.header)
	}
	reader, err := gzip.NewReader(bytes.NewReader(zipped.body))
	if err != nil {
		t.Fatal(err)
	}
	var unzipped bytes.Buffer
	if _, err := unzipped.ReadFrom(reader); err != nil || !bytes.Equal(unzipped.Bytes(), plain.body) {
		t.Errorf("unzipped %q (%v)", unzipped.Bytes(), err)
	}
	variance := f.expect(200, "GET", path+"?layer=variance", "", "Accept-Encoding", "identity")
	if string(variance.body) != head+strings.Repeat("\x00", 24) {
		t.Errorf("variance %q", variance.body)
	}
	if got := f.expect(304, "GET", path, "", "If-None-Match", `"f"`, "Accept-Encoding", "gzip"); got.header.Get("Content-Encoding") != "" {
		t.Errorf("headers of nothing: %v", got.header)
	}
	f.expectProblem(422, "query.layer", f.do("GET", path+"?layer=depth", ""))
}

func TestSmallImages(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.farm.CompleteRound(id, job.ConvergencePoint{Round: 1, FilmSHA256: "f"},
		job.Image{Width: 64, Height: 32, RGB: make([]float32, 3*64*32)}, func(*job.Snapshot) {})
	small, err := png.Decode(bytes.NewReader(f.expect(200, "GET", "/v1/jobs/"+id+"/image.png?size=16", "").body))
	if err != nil || small.Bounds().Dx() != 16 || small.Bounds().Dy() != 8 {
		t.Errorf("%v (%v)", small, err)
	}
	for film, want := range map[string]string{"f": "private, max-age=86400", "e": "private, no-cache", "": "private, no-cache"} {
		got := f.expect(200, "GET", "/v1/jobs/"+id+"/image.png?film="+film, "")
		if cache := got.header.Values("Cache-Control"); len(cache) != 1 || cache[0] != want {
			t.Errorf("film %q: Cache-Control %q, want %q", film, cache, want)
		}
	}
	f.expectProblem(422, "query.size", f.do("GET", "/v1/jobs/"+id+"/image.png?size=8", ""))
}

func TestThePageComesCompressed(t *testing.T) {
	f := newFixture(t)
	const limit = 150 << 10 // of the whole page, as browsers get it
	size := 0
	for _, path := range []string{"/", "/app.js", "/app.css", "/icon.svg"} {
		got := f.expect(200, "GET", path, "", "Accept-Encoding", "gzip")
		if got.header.Get("Content-Encoding") != "gzip" || got.header.Get("ETag") == "" {
			t.Errorf("%s: headers %v", path, got.header)
		}
		size += len(got.body)
	}
	if size > limit {
		t.Errorf("the page has %d bytes, more than %d", size, limit)
	}
	plain := f.expect(200, "GET", "/", "", "Accept-Encoding", "identity")
	if !strings.Contains(string(plain.body), "<title>") {
		t.Errorf("without compression: %.80s", plain.body)
	}
}

func TestStoredScenes(t *testing.T) {
	f := newFixture(t)
	if got := f.expect(200, "GET", "/v1/scenes", ""); string(got.body) != "{\"scenes\":[]}\n" {
		t.Errorf("no scenes: %s", got.body)
	}
	f.expect(201, "POST", "/v1/scenes", zipOf(t, map[string]string{"a.xml": "<scene/>", "b.obj": "v"}))
	f.expect(201, "POST", "/v1/scenes", zipOf(t, map[string]string{"only.obj": "v"}))
	got := decode[struct {
		Scenes []struct {
			Digest  string
			Entries []string
			Files   int
			Bytes   int
		}
	}](t, f.expect(200, "GET", "/v1/scenes", ""))
	if len(got.Scenes) != 1 || got.Scenes[0].Entries[0] != "a.xml" || got.Scenes[0].Files != 2 || got.Scenes[0].Bytes != 9 {
		t.Errorf("%+v", got)
	}
}

func TestTheInterfaceDescribesOptionsForForms(t *testing.T) {
	f := newFixture(t)
	document := decode[struct {
		Components struct {
			Schemas map[string]struct {
				Properties map[string]struct {
					Choices     []string `json:"x-choices"`
					Integrators []string `json:"x-integrators"`
					Summary     string   `json:"x-summary"`
				}
			}
		}
	}](t, f.expect(200, "GET", "/openapi.json", ""))
	kernel := document.Components.Schemas["Request"].Properties["kernel"]
	if len(kernel.Choices) < 2 || len(kernel.Integrators) != 2 || kernel.Summary == "" {
		t.Errorf("kernel: %+v", kernel)
	}
	if document.Components.Schemas["StopRules"].Properties["rounds"].Summary == "" {
		t.Error("stop.rounds has no summary")
	}
}
