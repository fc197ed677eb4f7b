package api

import (
	"fmt"
	"testing"
	"time"

	"metrofarm/services/internal/auth"
)

func TestAddressesOfOneNetworkAreOneClient(t *testing.T) {
	for _, c := range []struct {
		a, b string
		same bool
	}{
		{"10.0.0.1:80", "10.0.0.1:81", true},
		{"10.0.0.1:80", "10.0.0.2:80", false},
		{"[::ffff:10.0.0.1]:80", "10.0.0.1:80", true},
		{"[2001:db8::1]:80", "[2001:db8::2]:80", true},
		{"[2001:db8:0:1::1]:80", "[2001:db8:0:2::1]:80", false},
		{"[fe80::1%eth0]:80", "[fe80::1%eth1]:80", true},
	} {
		if same := clientKey(auth.Identity{}, c.a) == clientKey(auth.Identity{}, c.b); same != c.same {
			t.Errorf("%s and %s: %v", c.a, c.b, same)
		}
	}
}

func TestManyAddressesTakeBoundedMemory(t *testing.T) {
	now := time.Unix(0, 0)
	limits := DefaultLimits()
	limits.RequestsPerSecond, limits.Burst = 1, 2
	g := newGate(limits, func() time.Time { return now })
	for i := range 3 * maxClients {
		g.take(fmt.Sprint("address ", i))
	}
	if len(g.clients) != maxClients {
		t.Errorf("%d clients are told apart, want %d", len(g.clients), maxClients)
	}
	if _, granted := g.take("one more"); granted {
		t.Error("those that do not fit have no common limit")
	}
	end, _ := g.openStream("address 0")
	now = now.Add(time.Hour)
	if _, granted := g.take("one more"); !granted {
		t.Error("an hour later there is no room")
	}
	if len(g.clients) != 2 {
		t.Errorf("%d clients after an hour, want the new one and the one with a stream", len(g.clients))
	}
	end()
}
