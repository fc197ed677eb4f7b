package api_test

import (
	"bytes"
	"log/slog"
	"maps"
	"net/http"
	"os"
	"path/filepath"
	"slices"
	"strings"
	"testing"
	"time"

	"github.com/danielgtaylor/huma/v2"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/auth"
	"metrofarm/services/internal/job"
)

// routeRoles is what every route of the interface needs. A new route belongs here, after a thought.
var routeRoles = map[string]auth.Role{
	"GET /healthz": auth.None,
	"GET /readyz":  auth.None,
	"/":            auth.None, // the page's files, which ask for the token

	"/v1/":                          auth.Read, // what does not exist
	"GET /docs":                     auth.Read,
	"GET /metrics":                  auth.Read,
	"GET /openapi.json":             auth.Read,
	"GET /openapi.yaml":             auth.Read,
	"GET /openapi-3.0.json":         auth.Read,
	"GET /openapi-3.0.yaml":         auth.Read,
	"GET /v1/autoscale":             auth.Read,
	"GET /v1/events":                auth.Read,
	"GET /v1/jobs":                  auth.Read,
	"GET /v1/jobs/{id}":             auth.Read,
	"GET /v1/jobs/{id}/anomalies":   auth.Read,
	"GET /v1/jobs/{id}/convergence": auth.Read,
	"GET /v1/jobs/{id}/events":      auth.Read,
	"GET /v1/jobs/{id}/image.exr":   auth.Read,
	"GET /v1/jobs/{id}/image.pfm":   auth.Read,
	"GET /v1/jobs/{id}/image.png":   auth.Read,
	"GET /v1/jobs/{id}/log":         auth.Read,
	"GET /v1/jobs/{id}/plan":        auth.Read,
	"GET /v1/jobs/{id}/scene":       auth.Read,
	"GET /v1/scenes":                auth.Read,
	"GET /v1/scenes/{sha256}":       auth.Read,
	"GET /v1/sequences":             auth.Read,
	"GET /v1/sequences/{id}":        auth.Read,
	"GET /v1/session":               auth.Read,
	"POST /v1/session":              auth.Read,
	"DELETE /v1/session":            auth.Read,
	"GET /v1/workers":               auth.Read,

	"POST /v1/jobs":             auth.Submit,
	"DELETE /v1/jobs/{id}":      auth.Submit, // one's own
	"PATCH /v1/jobs/{id}":       auth.Submit, // one's own
	"POST /v1/jobs/{id}/cancel": auth.Submit, // one's own
	"POST /v1/jobs/{id}/finish": auth.Submit, // one's own
	"POST /v1/jobs/{id}/refine": auth.Submit, // one's own
	"POST /v1/jobs/{id}/pause":  auth.Submit, // one's own
	"POST /v1/jobs/{id}/resume": auth.Submit, // one's own
	"POST /v1/scenes":           auth.Submit,

	"POST /v1/sequences":             auth.Submit,
	"DELETE /v1/sequences/{id}":      auth.Submit, // one's own
	"POST /v1/sequences/{id}/cancel": auth.Submit, // one's own
	"POST /v1/sequences/{id}/pause":  auth.Submit, // one's own
	"POST /v1/sequences/{id}/resume": auth.Submit, // one's own

	"POST /v1/workers/{id}/drain": auth.Admin,
}

func TestEveryRouteHasItsRole(t *testing.T) {
	got, err := api.RolesOf(api.Options{Service: newFixture(t).farm})
	if err != nil {
		t.Fatal(err)
	}
	for _, route := range slices.Sorted(maps.Keys(got)) {
		want, known := routeRoles[route]
		if !known || want != got[route] {
			t.Errorf("%s needs %s; the table has it %v, as %s", route, got[route], known, want)
		}
	}
	for route := range routeRoles {
		if _, exists := got[route]; !exists {
			t.Errorf("there is no %s", route)
		}
	}
}

func TestOperationsWithoutRolesAreRefused(t *testing.T) {
	operation := func(security []map[string][]string) *huma.Operation {
		return &huma.Operation{OperationID: "x", Method: "GET", Path: "/x", Security: security}
	}
	for _, wrong := range [][]map[string][]string{nil, {{}}, {{"token": {"root"}}}, {{"session": {"read"}}}} {
		if api.Settle(operation(wrong)) == nil {
			t.Errorf("%v is taken", wrong)
		}
	}
	for _, right := range [][]map[string][]string{{}, {{"token": {"read"}}}} {
		if err := api.Settle(operation(right)); err != nil {
			t.Errorf("%v: %v", right, err)
		}
	}
}

// guarded is a fixture that asks for tokens.
type guarded struct {
	*fixture
	tokens map[auth.Role]string // the user of each is its role
	other  string               // of another user who may submit
	file   string               // of the tokens
	known  *auth.Tokens
	log    *bytes.Buffer
	now    time.Time
}

func newGuarded(t *testing.T, change func(*api.Options)) *guarded {
	t.Helper()
	g := &guarded{tokens: map[auth.Role]string{}, log: &bytes.Buffer{}, now: time.Now()}
	var lines strings.Builder
	create := func(role auth.Role, user string) string {
		token, line, err := auth.NewToken(role, user)
		if err != nil {
			t.Fatal(err)
		}
		lines.WriteString(line + "\n")
		return token
	}
	for _, role := range []auth.Role{auth.Read, auth.Submit, auth.Admin} {
		g.tokens[role] = create(role, role.String())
	}
	g.other = create(auth.Submit, "other")
	path := filepath.Join(t.TempDir(), "tokens")
	if err := os.WriteFile(path, []byte(lines.String()), 0o600); err != nil {
		t.Fatal(err)
	}
	tokens, err := auth.OpenTokens(path)
	if err != nil {
		t.Fatal(err)
	}
	g.file, g.known = path, tokens
	g.fixture = newFixtureWith(t, func(o *api.Options) {
		o.Tokens, o.SessionKey, o.Now = tokens, make([]byte, 32), func() time.Time { return g.now }
		o.Logger = slog.New(slog.NewTextHandler(g.log, &slog.HandlerOptions{Level: slog.LevelDebug}))
		if change != nil {
			change(o)
		}
	})
	return g
}

// as does a request with the token of a role.
func (g *guarded) as(role auth.Role, method, path, body string, headers ...string) answer {
	g.t.Helper()
	if role != auth.None {
		headers = append(headers, "Authorization", "Bearer "+g.tokens[role])
	}
	return g.do(method, path, body, headers...)
}

// requestOf a route: events of a job that does not exist end at once, as do those of a farm that are asked for wrongly.
func requestOf(route string) (method, path string) {
	if route == "GET /v1/events" {
		return "GET", "/v1/events?none"
	}
	method, path, found := strings.Cut(route, " ")
	if !found {
		method, path = "GET", route
	}
	return method, strings.NewReplacer("{id}", "x", "{sha256}", "y").Replace(path)
}

func TestRoutesLetInWhoHasTheRole(t *testing.T) {
	g := newGuarded(t, nil)
	for route, needed := range routeRoles {
		method, path := requestOf(route)
		for role := auth.None; role <= auth.Admin; role++ {
			got := g.as(role, method, path, "")
			refused := got.status == http.StatusUnauthorized || got.status == http.StatusForbidden
			switch {
			case refused == role.Includes(needed):
				t.Errorf("%s as %s: %d %s", route, role, got.status, got.body)
			case refused && role == auth.None:
				g.expectProblem(http.StatusUnauthorized, "", got)
			case refused:
				g.expectProblem(http.StatusForbidden, "", got)
			}
			if challenge := got.header.Get("WWW-Authenticate"); strings.HasPrefix(challenge, "Bearer ") != refused {
				t.Errorf("%s as %s: challenge %q", route, role, challenge)
			}
		}
	}
}

func TestWhatIsNoTokenLetsNobodyIn(t *testing.T) {
	g := newGuarded(t, nil)
	token := g.tokens[auth.Admin]
	for _, header := range []string{
		"", "Bearer", "Bearer ", "Bearer x", "Bearer " + token + "x", "Bearer  " + token, "Basic " + token, token, "Bearer " + token + ", Bearer x",
	} {
		got := g.do("GET", "/v1/jobs", "", "Authorization", header)
		g.expectProblem(http.StatusUnauthorized, "", got)
		if strings.Contains(string(got.body), token) {
			t.Errorf("the answer repeats the token: %s", got.body)
		}
	}
	g.expectProblem(http.StatusUnauthorized, "", g.do("GET", "/v1/jobs?token="+token, ""))
	g.expect(200, "GET", "/v1/jobs", "", "Authorization", "bearer "+token)
}

func TestJobsBelongToTheirUsers(t *testing.T) {
	g := newGuarded(t, nil)
	submit := func(role auth.Role, headers ...string) string {
		s := decode[job.Snapshot](t, g.as(role, "POST", "/v1/jobs", request, headers...))
		if s.User != role.String() {
			t.Errorf("the job of %s is %q's", role, s.User)
		}
		if got := g.as(auth.Submit, "PATCH", "/v1/jobs/"+s.ID, `{"priority":2}`); (got.status == 200) != (role == auth.Submit) {
			t.Errorf("a user changes the job of %s: %d %s", role, got.status, got.body)
		}
		if got := g.as(auth.Admin, "PATCH", "/v1/jobs/"+s.ID, `{"priority":3}`); got.status != 200 {
			t.Errorf("admin changes the job of %s: %d %s", role, got.status, got.body)
		}
		g.as(role, "POST", "/v1/jobs/"+s.ID+"/cancel", "")
		return s.ID
	}
	of, others, again := submit(auth.Submit), submit(auth.Admin), submit(auth.Submit)
	g.expectProblem(http.StatusForbidden, "", g.as(auth.Submit, "DELETE", "/v1/jobs/"+others, ""))
	for id, role := range map[string]auth.Role{of: auth.Submit, others: auth.Admin, again: auth.Admin} {
		if got := g.as(role, "DELETE", "/v1/jobs/"+id, ""); got.status != http.StatusNoContent {
			t.Errorf("%s deletes %s: %d %s", role, id, got.status, got.body)
		}
	}
	first, foreign := submit(auth.Submit, "Idempotency-Key", "k"), submit(auth.Admin, "Idempotency-Key", "k")
	if first == foreign {
		t.Error("another user's idempotency key returned this one's job")
	}
}

// Whatever changes a job asks for its user, or an admin: another one who may submit is refused.
func TestOnlyItsUserAndAdminsChangeAJob(t *testing.T) {
	g := newGuarded(t, nil)
	bearer := func(token string) []string { return []string{"Authorization", "Bearer " + token} }
	for route := range routeRoles {
		method, path, _ := strings.Cut(route, " ")
		if method == "GET" || !strings.HasPrefix(path, "/v1/jobs/{id}") {
			continue
		}
		body := map[string]string{"PATCH /v1/jobs/{id}": `{"priority":1}`, "POST /v1/jobs/{id}/refine": `{"rounds":9}`}[route]
		id := decode[job.Snapshot](t, g.as(auth.Submit, "POST", "/v1/jobs", request)).ID
		path = strings.Replace(path, "{id}", id, 1)
		refused := g.do(method, path, body, bearer(g.other)...)
		g.expectProblem(http.StatusForbidden, "", refused)
		if !strings.Contains(string(refused.body), "this is a job of submit") {
			t.Errorf("%s by another user: %s", route, refused.body)
		}
		if now := decode[job.Snapshot](t, g.as(auth.Read, "GET", "/v1/jobs/"+id, "")); now.State != job.Queued || now.Paused {
			t.Errorf("%s by another user: the job is %s, paused %v", route, now.State, now.Paused)
		}
		// The job may be in no state for it, which is for its user and for admins to hear.
		for _, role := range []auth.Role{auth.Submit, auth.Admin} {
			if got := g.as(role, method, path, body); got.status == http.StatusForbidden {
				t.Errorf("%s by %s: %d %s", route, role, got.status, got.body)
			}
		}
	}
}

func TestMetricsMayBeOpen(t *testing.T) {
	g := newGuarded(t, func(o *api.Options) { o.OpenMetrics = true })
	g.expect(200, "GET", "/metrics", "")
	g.expectProblem(http.StatusUnauthorized, "", g.do("GET", "/v1/jobs", ""))
}

func TestWithoutTokensEverybodyMayDoEverything(t *testing.T) {
	f := newFixture(t)
	if s := decode[job.Snapshot](t, f.expect(201, "POST", "/v1/jobs", request)); s.User != "" {
		t.Errorf("user %q", s.User)
	}
	if got := string(f.expect(200, "GET", "/v1/session", "").body); !strings.Contains(got, `"tokens":false,"user":"","role":"admin"`) {
		t.Errorf("session %s", got)
	}
	f.expectProblem(http.StatusConflict, "", f.do("POST", "/v1/session", ""))
}

// login returns the cookie of a session, as a browser sends it.
func (g *guarded) login(role auth.Role, headers ...string) (cookie string, attributes *http.Cookie) {
	g.t.Helper()
	got := g.as(role, "POST", "/v1/session", "", headers...)
	set, err := http.ParseSetCookie(got.header.Get("Set-Cookie"))
	if got.status != 200 || err != nil {
		g.t.Fatalf("%d %s, error %v", got.status, got.body, err)
	}
	return set.Name + "=" + set.Value, set
}

func TestSessionsReadEverythingAndChangeFromOwnPagesOnly(t *testing.T) {
	g := newGuarded(t, nil)
	id := decode[job.Snapshot](t, g.as(auth.Submit, "POST", "/v1/jobs", request)).ID
	cookie, attributes := g.login(auth.Submit)
	if !attributes.HttpOnly || attributes.SameSite != http.SameSiteStrictMode || attributes.MaxAge != 12*3600 ||
		attributes.Secure || attributes.Path != "/" || attributes.Domain != "" {
		t.Errorf("cookie %+v", attributes)
	}
	if events := g.readEvents("/v1/jobs/"+id+"/events", "id: 1", "Cookie", cookie); strings.HasSuffix(events, "(end)") {
		t.Errorf("events by cookie: %s", events)
	}
	origin := g.server.URL
	cases := []struct {
		name    string
		status  int
		headers []string
	}{
		{"own page", 200, []string{"Sec-Fetch-Site", "same-origin", "Origin", origin}},
		{"own page without fetch metadata", 200, []string{"Origin", origin}},
		{"nobody knows", 403, nil},
		{"another site", 403, []string{"Sec-Fetch-Site", "cross-site", "Origin", "https://evil.example"}},
		{"another port of this host", 403, []string{"Sec-Fetch-Site", "same-site"}},
		{"typed in", 403, []string{"Sec-Fetch-Site", "none"}},
		{"another origin", 403, []string{"Origin", "http://evil.example"}},
		{"a sandbox", 403, []string{"Origin", "null"}},
	}
	for _, c := range cases {
		got := g.do("POST", "/v1/jobs/"+id+"/pause", "", append(c.headers, "Cookie", cookie)...)
		if got.status != c.status {
			t.Errorf("%s: %d, want %d", c.name, got.status, c.status)
		}
	}
	g.expectProblem(403, "", g.do("POST", "/v1/workers/x/drain", "", "Cookie", cookie, "Origin", origin))
	g.expectProblem(403, "", g.do("POST", "/v1/session", "", "Cookie", cookie, "Origin", origin))
	g.expectProblem(401, "", g.do("GET", "/v1/jobs", "", "Cookie", cookie, "Authorization", "Bearer x"))
	closed := g.expect(204, "DELETE", "/v1/session", "", "Cookie", cookie, "Origin", origin)
	if gone, err := http.ParseSetCookie(closed.header.Get("Set-Cookie")); err != nil || gone.MaxAge >= 0 || gone.Value != "" {
		t.Errorf("the cookie stays: %+v, error %v", gone, err)
	}
	g.now = g.now.Add(12*time.Hour + time.Second)
	g.expectProblem(401, "", g.do("GET", "/v1/jobs", "", "Cookie", cookie))
}

func TestSessionsUnderTLSStayThere(t *testing.T) {
	g := newGuarded(t, nil)
	cookie, attributes := g.login(auth.Read, "X-Forwarded-Proto", "https")
	if !attributes.Secure || !strings.HasPrefix(attributes.Name, "__Host-") {
		t.Errorf("cookie %+v", attributes)
	}
	g.expect(200, "GET", "/v1/jobs", "", "Cookie", cookie, "X-Forwarded-Proto", "https")
	g.expectProblem(401, "", g.do("GET", "/v1/jobs", "", "Cookie", cookie))
}

func TestTheLogTellsWhoDidWhatAndNoSecret(t *testing.T) {
	g := newGuarded(t, nil)
	cookie, _ := g.login(auth.Submit)
	for route := range routeRoles {
		method, path := requestOf(route)
		for role := auth.None; role <= auth.Admin; role++ {
			g.as(role, method, path+"?token="+g.tokens[auth.Admin], "")
		}
		g.do(method, path, "", "Cookie", cookie)
		g.do(method, path, "", "Authorization", "Basic "+g.tokens[auth.Admin])
		g.do(method, path, `{"scene":"`+g.tokens[auth.Admin]+`"}`, "Authorization", g.tokens[auth.Admin])
	}
	g.as(auth.Admin, "POST", "/v1/workers/x/drain", "")
	g.server.Close() // after the last line
	log := g.log.String()
	for role, token := range g.tokens {
		if strings.Contains(log, token) || strings.Contains(log, token[3:20]) {
			t.Errorf("the token of %s is in the log", role)
		}
	}
	if _, value, _ := strings.Cut(cookie, "="); strings.Contains(log, value[:20]) {
		t.Error("the session is in the log")
	}
	for _, want := range []string{
		"msg=request user=admin method=POST path=/v1/workers/x/drain status=404",
		"user=read method=POST path=/v1/workers/x/drain status=403",
		`user="" method=DELETE path=/v1/jobs/x status=401`,
	} {
		if !strings.Contains(log, want) {
			t.Errorf("the log has no %q", want)
		}
	}
	for _, line := range strings.Split(strings.TrimSpace(log), "\n") {
		if strings.Contains(line, "msg=request ") && !strings.Contains(line, " duration=") {
			t.Fatalf("no duration in %s", line)
		}
	}
}

func TestHostsAreChecked(t *testing.T) {
	f := newFixtureWith(t, func(o *api.Options) { o.CheckHosts, o.Hosts = true, []string{"Farm.example", "10.0.0.7"} })
	for host, status := range map[string]int{
		"localhost": 200, "localhost:8080": 200, "127.0.0.1": 200, "127.8.9.1:80": 200, "[::1]:8080": 200, "[::1]": 200,
		"farm.EXAMPLE:8080": 200, "10.0.0.7": 200,
		"evil.example": 421, "localhost.evil.example": 421, "10.0.0.8": 421, "192.168.1.1:8080": 421, "farm.example.": 421, "[::2]": 421,
	} {
		if got := f.do("GET", "/v1/jobs", "", "Host", host); got.status != status {
			t.Errorf("%s: %d, want %d", host, got.status, status)
		}
	}
	unchecked := newFixtureWith(t, func(o *api.Options) { o.CheckHosts = false })
	unchecked.expect(200, "GET", "/v1/jobs", "", "Host", "farm.example")
}

func TestAnswersTellBrowsersToBeStrict(t *testing.T) {
	g := newGuarded(t, nil)
	for _, path := range []string{"/", "/app.js", "/v1/jobs", "/nothing"} {
		header := g.do("GET", path, "", "Origin", "https://evil.example").header
		for name, want := range map[string]string{
			"Content-Security-Policy":      "frame-ancestors 'none'",
			"X-Content-Type-Options":       "nosniff",
			"X-Frame-Options":              "DENY",
			"Referrer-Policy":              "no-referrer",
			"Cross-Origin-Resource-Policy": "same-origin",
			"Cross-Origin-Opener-Policy":   "same-origin",
			"Cache-Control":                "private",
		} {
			if !strings.Contains(header.Get(name), want) {
				t.Errorf("%s: %s is %q, want %q", path, name, header.Get(name), want)
			}
		}
		for name := range header {
			if strings.HasPrefix(name, "Access-Control-") {
				t.Errorf("%s has %s", path, name)
			}
		}
	}
	preflight := g.do("OPTIONS", "/v1/jobs", "", "Origin", "https://evil.example", "Access-Control-Request-Method", "POST")
	if preflight.status < 400 || preflight.header.Get("Access-Control-Allow-Origin") != "" {
		t.Errorf("preflight: %d, %v", preflight.status, preflight.header)
	}
}

// A stream may be open for days: it ends when what let its reader in does.
func TestStreamsEndWithTheTokenOfTheirReaders(t *testing.T) {
	g := newGuarded(t, func(o *api.Options) { o.Now = time.Now }) // comments come by the clock
	id := decode[job.Snapshot](t, g.as(auth.Submit, "POST", "/v1/jobs", request)).ID
	signIn := g.as(auth.Read, "POST", "/v1/session", "")
	cookie, _, _ := strings.Cut(signIn.header.Get("Set-Cookie"), ";")
	shown := [][2]string{{"Authorization", "Bearer " + g.tokens[auth.Read]}, {"Cookie", cookie}}
	ended := make(chan string)
	kept := make(chan string)
	// open returns once the stream has told something.
	open := func(path, name, value string) *stream {
		opened := g.openEvents(path, name, value)
		if text, found := opened.upTo("event: "); !found {
			t.Fatalf("a stream ended before it told anything: %q", text)
		}
		return opened
	}
	for _, path := range []string{"/v1/events", "/v1/jobs/" + id + "/events"} {
		for _, header := range shown {
			reader := open(path, header[0], header[1])
			go func() { ended <- reader.until("(none)") }()
		}
		other := open(path, "Authorization", "Bearer "+g.tokens[auth.Admin])
		go func() { kept <- other.until("event: gone") }()
	}
	lines, err := os.ReadFile(g.file)
	if err != nil {
		t.Fatal(err)
	}
	_, others, _ := strings.Cut(string(lines), "\n") // the reader's is the first
	if err := os.WriteFile(g.file, []byte(others), 0o600); err != nil {
		t.Fatal(err)
	}
	if err := g.known.Reload(); err != nil {
		t.Fatal(err)
	}
	for range 4 {
		select {
		case <-ended:
		case <-time.After(20 * time.Second):
			t.Fatal("a stream outlives the token of its reader")
		}
	}
	select {
	case text := <-kept:
		t.Errorf("the stream of another token ended: %q", text)
	case <-time.After(100 * time.Millisecond): // five comments
	}
	g.server.CloseClientConnections()
	for range 2 {
		<-kept
	}
}
