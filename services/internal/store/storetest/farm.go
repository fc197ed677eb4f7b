package storetest

import (
	"context"
	"fmt"
	"sync"
	"testing"

	"metrofarm/services/internal/store"
)

func swap(t *testing.T, s store.Store, old, next, want string) {
	t.Helper()
	if now, err := s.SwapFarm(context.Background(), old, next); err != nil || now != want {
		t.Errorf("%q for %q: the farm is %q, error %v; want %q", next, old, now, err, want)
	}
}

func testFarm(t *testing.T, site Site) {
	s := site.Open(t)
	swap(t, s, "", "", "")
	swap(t, s, "another", "a", "")
	swap(t, s, "", "a", "a")
	swap(t, s, "", "b", "a")
	swap(t, s, "", "", "a")
	swap(t, s, "a", "b", "b")
	swap(t, s, "a", "b", "b") // its answer was lost
	check(t, s.Close())
	s = site.Open(t)
	defer s.Close()
	swap(t, s, "a", "c", "b")
	if ids := waiting(t, s); len(ids) != 0 {
		t.Errorf("waiting: %v", ids)
	}
}

func testFarmRace(t *testing.T, site Site) {
	s := site.Open(t)
	defer s.Close()
	var mu sync.Mutex
	farms := make(map[string]bool)
	together(8, func(i int) {
		now, err := s.SwapFarm(context.Background(), "", fmt.Sprintf("farm-%d", i))
		if err != nil {
			t.Error(err)
		}
		mu.Lock()
		farms[now] = true
		mu.Unlock()
	})
	if len(farms) != 1 {
		t.Errorf("farms %v, want one", farms)
	}
}
