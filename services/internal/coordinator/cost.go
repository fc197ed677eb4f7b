package coordinator

import (
	"fmt"
	"math"
	"time"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// maxThreads of a worker: what it claims bounds the CPU time that its user is charged.
const maxThreads = 1 << 12

// cpuTime is the CPU time, in seconds, that a worker reports for tasks, cut to what it can have spent on
// them: all its threads since it was granted the first of these leases or, where it holds none of them any
// more, since the job started. It fails for times that no correct worker reports. Requires: mu.
func (r *run) cpuTime(w worker, reported float64, leases ...*farmv1.LeaseRef) (float64, error) {
	if math.IsNaN(reported) || math.IsInf(reported, 0) || reported < 0 {
		return 0, &malformedError{fmt.Sprintf("cpu_seconds is %v: must be finite and not negative", reported)}
	}
	now := r.c.options.Now()
	since := now
	for _, l := range leases {
		if at, held := r.table.Granted(ref(l), w.id); held && at.Before(since) {
			since = at
		}
	}
	if since.Equal(now) && r.rec.StartedAt != nil {
		since = *r.rec.StartedAt
	}
	return min(reported, max(now.Sub(since), time.Duration(0)).Seconds()*float64(max(w.threads, 1))), nil
}
