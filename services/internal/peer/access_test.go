package peer

import (
	"net/http"
	"os"
	"path/filepath"
	"strings"
	"testing"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

// tokensOf makes tokens of the roles and the file that coordinators share.
func tokensOf(t *testing.T, roles ...auth.Role) (tokens []string, file *auth.Tokens) {
	t.Helper()
	var lines []string
	for _, role := range roles {
		token, line, err := auth.NewToken(role, role.String())
		if err != nil {
			t.Fatal(err)
		}
		tokens, lines = append(tokens, token), append(lines, line)
	}
	path := filepath.Join(t.TempDir(), "tokens")
	if err := os.WriteFile(path, []byte(strings.Join(lines, "\n")), 0o600); err != nil {
		t.Fatal(err)
	}
	file, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	return tokens, file
}

func bearer(token string) map[string]string {
	return map[string]string{"Authorization": "Bearer " + token}
}

func guarded(file *auth.Tokens) func(*api.Options) {
	return func(o *api.Options) {
		o.Tokens, o.SessionKey = file, []byte(strings.Repeat("k", 32))
	}
}

func TestTheTokenGoesAlong(t *testing.T) {
	tokens, file := tokensOf(t, auth.Read, auth.Admin)
	owner, asked, id := newFarmWith(t, guarded(file))
	owner.SetWorkers(job.Worker{ID: "w-1", State: "idle"})
	jobURL := asked.url + "/v1/jobs/" + id
	if response, _ := do(t, http.MethodGet, jobURL, nil); response.StatusCode != http.StatusUnauthorized || owner.served.Load() != 0 {
		t.Errorf("without a token: %s, %d requests to the owner", response.Status, owner.served.Load())
	}
	for i, want := range []int{http.StatusForbidden, http.StatusOK} {
		if response, body := do(t, http.MethodGet, jobURL, bearer(tokens[i])); response.StatusCode != http.StatusOK {
			t.Errorf("%s: %s", response.Status, body)
		}
		if response, body := do(t, http.MethodPost, jobURL+"/pause", bearer(tokens[i])); response.StatusCode != want {
			t.Errorf("pause: %s: %s", response.Status, body)
		}
		if response, body := do(t, http.MethodPost, asked.url+"/v1/workers/w-1/drain", bearer(tokens[i])); response.StatusCode != want {
			t.Errorf("drain: %s: %s", response.Status, body)
		}
	}
}

func TestASessionGoesAlong(t *testing.T) {
	tokens, file := tokensOf(t, auth.Admin)
	for _, proxy := range []string{"", "https"} { // by which the cookie is named
		owner, asked, id := newFarmWith(t, guarded(file))
		owner.SetWorkers(job.Worker{ID: "w-1", State: "idle"})
		header := bearer(tokens[0])
		header["X-Forwarded-Proto"] = proxy
		response, body := do(t, http.MethodPost, asked.url+"/v1/session", header)
		if response.StatusCode != http.StatusOK || len(response.Cookies()) != 1 {
			t.Fatalf("%s: %s", response.Status, body)
		}
		cookie := response.Cookies()[0]
		header = map[string]string{
			"Cookie": cookie.Name + "=" + cookie.Value, "Sec-Fetch-Site": "same-origin", "X-Forwarded-Proto": proxy,
		}
		if response, body := do(t, http.MethodPost, asked.url+"/v1/jobs/"+id+"/pause", header); response.StatusCode != http.StatusOK {
			t.Errorf("pause: %s: %s", response.Status, body)
		}
		if response, body := do(t, http.MethodPost, asked.url+"/v1/workers/w-1/drain", header); response.StatusCode != http.StatusOK {
			t.Errorf("drain: %s: %s", response.Status, body)
		}
		if _, body := do(t, http.MethodGet, asked.url+"/v1/jobs", header); strings.Contains(body, `"stale":true`) {
			t.Errorf("the other did not answer: %s", body)
		}
		header["Sec-Fetch-Site"] = "cross-site"
		if response, _ := do(t, http.MethodPost, asked.url+"/v1/jobs/"+id+"/resume", header); response.StatusCode != http.StatusForbidden {
			t.Errorf("from a foreign page: %s", response.Status)
		}
	}
}

// TestRequestsAreCountedOnce: by the coordinator that was asked. Who only claims to be one is counted.
func TestRequestsAreCountedOnce(t *testing.T) {
	const burst = 4
	owner, asked, id := newFarmWith(t, func(o *api.Options) {
		o.Limits = api.DefaultLimits()
		o.Limits.RequestsPerSecond, o.Limits.Burst = 1e-6, burst
	})
	knock := func(m *member, header map[string]string) (granted int) {
		for range burst + 2 {
			response, _ := do(t, http.MethodGet, m.url+"/v1/jobs/"+id, header)
			switch response.StatusCode {
			case http.StatusOK:
				granted++
			case http.StatusTooManyRequests:
			default:
				t.Fatal(response.Status)
			}
		}
		return granted
	}
	if granted := knock(asked, nil); granted != burst {
		t.Errorf("%d requests by way of the other, want %d", granted, burst)
	}
	if granted := knock(owner, map[string]string{forwardedHeader: asked.secret, "X-Forwarded-For": "192.0.2.1"}); granted != burst {
		t.Errorf("%d requests with a wrong secret, want %d", granted, burst)
	}
	if granted := knock(owner, map[string]string{forwardedHeader: owner.secret}); granted != burst+2 {
		t.Errorf("%d requests with the secret", granted)
	}
}
