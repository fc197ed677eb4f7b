package job

import "errors"

// Sentinels that cross package borders. Wrap them with %w and the details.
var (
	// ErrNotFound: no such job, scene or worker.
	ErrNotFound = errors.New("not found")
	// ErrConflict: the object's state does not allow this (a finished job, a reused key).
	ErrConflict = errors.New("conflict")
	// ErrNoReport: no worker has looked at the scene yet.
	ErrNoReport = errors.New("no worker has looked at the scene yet")
	// ErrNoImage: no round is complete yet.
	ErrNoImage = errors.New("no round is complete yet")
	// ErrUnavailable: it cannot be done or told right now; asking again later may help.
	ErrUnavailable = errors.New("not available at the moment")
	// ErrTooMany: there are as many jobs that have not ended as there may be; asking again later may help.
	ErrTooMany = errors.New("too many jobs")
	// ErrInvalid: the request is wrong; see FieldError for where.
	ErrInvalid = errors.New("invalid request")
)

// FieldError names the field of a request that is wrong and what would be right. It wraps
// ErrInvalid.
type FieldError struct {
	Field  string // as in the JSON document, for example "stop.target_error"
	Detail string
}

func (e *FieldError) Error() string { return e.Field + ": " + e.Detail }

// Unwrap makes errors.Is(err, ErrInvalid) true.
func (e *FieldError) Unwrap() error { return ErrInvalid }

// In is the error for a document that has what is wrong in this member.
func (e *FieldError) In(member string) *FieldError {
	return &FieldError{Field: member + "." + e.Field, Detail: e.Detail}
}
