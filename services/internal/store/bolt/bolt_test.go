package bolt

import (
	"path/filepath"
	"testing"

	"metrofarm/services/internal/store"
	"metrofarm/services/internal/store/storetest"
)

func TestConformance(t *testing.T) {
	storetest.Run(t, func(t *testing.T, place string) store.Store {
		t.Helper()
		s, err := Open(filepath.Join(place, "metrofarm.db"))
		if err != nil {
			t.Fatal(err)
		}
		return s
	})
}
