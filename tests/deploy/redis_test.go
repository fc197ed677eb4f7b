package deploy

import (
	"slices"
	"strings"
	"testing"
	"time"
)

// Redis refuses what does not fit, which it can recover from, before it is killed. It copies what changes
// while it rewrites its file: half of its container's memory is for data.
func checkRedisMemory(t *testing.T, c container) {
	t.Helper()
	at := slices.Index(c.arguments, "--maxmemory")
	if at < 0 || c.limit == 0 {
		t.Fatalf("Redis with %v and a limit of %d bytes is killed when its memory is used up", c.arguments, c.limit)
	}
	// Redis writes mb for 1024 * 1024 bytes.
	if got := size(t, strings.TrimSuffix(c.arguments[at+1], "mb")+"Mi"); got > c.limit/2 || got < c.limit/3 {
		t.Errorf("Redis takes %d bytes of data; half of its limit is %d", got, c.limit/2)
	}
}

func TestRedisRefusesBeforeItIsKilled(t *testing.T) {
	checkRedisMemory(t, readCompose(t).Services["redis"].inCompose(t))
	eachRelease(t, func(t *testing.T, r *release) {
		for _, w := range r.workloads() {
			if w.name == releaseName+"-redis" {
				checkRedisMemory(t, inPod(w.template.Spec.Containers[0]))
			}
		}
	})
}

// What is kept of jobs lies in the memory of Redis: those that ended long ago must not fill it.
func TestOldJobsAreDeleted(t *testing.T) {
	check := func(t *testing.T, arguments []string) {
		t.Helper()
		at := slices.IndexFunc(arguments, func(a string) bool { return strings.HasPrefix(a, "--keep-jobs=") })
		if at < 0 {
			t.Fatalf("jobs are kept for ever: %v", arguments)
		}
		_, text, _ := strings.Cut(arguments[at], "=")
		if keeps, err := time.ParseDuration(text); err != nil || keeps < 24*time.Hour {
			t.Errorf("jobs are kept for %q, error %v", text, err)
		}
	}
	for _, name := range []string{"coordinator-1", "coordinator-2"} {
		check(t, readCompose(t).Services[name].inCompose(t).arguments)
	}
	eachRelease(t, func(t *testing.T, r *release) {
		check(t, r.workload(t, releaseName+"-coordinator").template.Spec.Containers[0].Args)
	})
}
