package api_test

import (
	"net/http"
	"strings"
	"testing"
)

func TestRequestsAreCountedByRoute(t *testing.T) {
	f := newFixture(t)
	id := f.submit()
	f.expect(http.StatusOK, http.MethodGet, "/v1/jobs/"+id, "")
	f.expect(http.StatusNotFound, http.MethodGet, "/v1/jobs/other", "")
	f.do("BREW", "/v1/coffee", "")
	served := string(f.expect(http.StatusOK, http.MethodGet, "/metrics", "").body)
	for _, series := range []string{
		`metrofarm_http_requests_total{code="201",method="POST",route="/v1/jobs"} 1`,
		`metrofarm_http_requests_total{code="200",method="GET",route="/v1/jobs/{id}"} 1`,
		`metrofarm_http_requests_total{code="404",method="GET",route="/v1/jobs/{id}"} 1`,
		`metrofarm_http_requests_total{code="404",method="other",route="/v1/"} 1`,
		`metrofarm_http_request_duration_seconds_count{route="/v1/jobs/{id}"} 2`,
		"metrofarm_sse_clients 0",
	} {
		if !strings.Contains(served, series+"\n") {
			t.Errorf("not served: %s", series)
		}
	}
	if strings.Contains(served, id) || strings.Contains(served, "coffee") {
		t.Errorf("a client can make series:\n%s", served)
	}
}
