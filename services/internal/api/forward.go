package api

import "net/http"

// retrySeconds is about how long a job is without owner when its coordinator dies.
const retrySeconds = "5"

// Unavailable answers that something cannot be had right now, for handlers around this package's.
func Unavailable(w http.ResponseWriter, detail string) {
	w.Header().Set("Retry-After", retrySeconds)
	writeProblem(w, http.StatusServiceUnavailable, detail)
}
