package bolt

import (
	"path/filepath"
	"sync/atomic"
	"testing"
	"time"

	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/storetest"
)

func TestConformance(t *testing.T) {
	storetest.Run(t, func(t *testing.T) storetest.Site {
		t.Helper()
		path := filepath.Join(t.TempDir(), "metrofarm.db")
		var offset atomic.Int64
		now := func() time.Time { return time.Unix(1000, offset.Load()) }
		return storetest.Site{
			Open: func(t *testing.T) store.Store {
				t.Helper()
				s, err := Open(path, now)
				if err != nil {
					t.Fatal(err)
				}
				return s
			},
			Pass: func(d time.Duration) { offset.Add(int64(d)) },
		}
	})
}
