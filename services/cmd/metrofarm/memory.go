package main

import (
	"errors"

	"github.com/KimMachineGun/automemlimit/memlimit"
)

// heapShare of the memory is what the garbage collector keeps to, beside what the system keeps for the
// process.
const heapShare = 0.9

// errUnknown: neither the control group nor the machine tells how much memory there is.
var errUnknown = errors.New("the memory of this machine is not known")

// available is the memory that this process may use, in bytes: the limit of its control group or all
// of the machine's, the smaller.
func available() (uint64, error) {
	var smallest uint64
	for _, provider := range []memlimit.Provider{memlimit.FromCgroup, memlimit.FromSystem} {
		if bytes, err := provider(); err == nil && bytes > 0 && (smallest == 0 || bytes < smallest) {
			smallest = bytes
		}
	}
	if smallest == 0 {
		return 0, errUnknown
	}
	return smallest, nil
}

// limitMemory lets the garbage collector keep to the memory that there is, unless GOMEMLIMIT says
// otherwise, and returns what there is; 0 if that is not known.
func limitMemory() int64 {
	bytes, err := available()
	if err != nil {
		return 0
	}
	// It fails for a bad AUTOMEMLIMIT only, without harm.
	_, _ = memlimit.Set(memlimit.WithProvider(memlimit.Limit(bytes)), memlimit.WithRatio(heapShare))
	return int64(bytes)
}
