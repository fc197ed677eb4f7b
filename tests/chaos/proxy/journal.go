package main

import (
	"encoding/json"
	"fmt"
	"log/slog"
	"os"
	"strings"
	"sync"
	"time"

	"google.golang.org/grpc/status"

	farmv1 "metrofarm/services/gen/metrofarm/farm/v1"
)

// Steps of a delivery or report: what one message to a coordinator was.
const (
	stepIntact    = "intact"     // as the worker sent it, for the first time
	stepCopy      = "copy"       // the same again, after an answer
	stepStale     = "stale"      // for the first time, long after its lease
	stepDamaged   = "damaged"    // with wrong content
	stepForged    = "forged"     // wrong, and its digests fit
	stepBrokenOff = "broken off" // its stream ended early
)

// entry is one message to a coordinator and the answer to it.
type entry struct {
	Time     float64  `json:"time"` // when it was answered, in seconds since 1970
	Sent     float64  `json:"sent"` // when it was sent
	Number   int      `json:"number"`
	Call     string   `json:"call"`
	Fault    string   `json:"fault"`
	Step     string   `json:"step"`
	Detail   string   `json:"detail,omitempty"`
	Upstream string   `json:"upstream"`
	Job      string   `json:"job"`
	Worker   string   `json:"worker"`
	Round    uint32   `json:"round"`
	Segments []uint32 `json:"segments,omitempty"`
	Task     string   `json:"task,omitempty"`
	Outcome  string   `json:"outcome"` // empty: no answer
	Message  string   `json:"message,omitempty"`
}

// journal is a file of entries, one JSON document a line.
type journal struct {
	mu   sync.Mutex
	file *os.File
}

func openJournal(path string) (*journal, error) {
	file, err := os.OpenFile(path, os.O_CREATE|os.O_APPEND|os.O_WRONLY, 0o644)
	if err != nil {
		return nil, fmt.Errorf("open the journal: %w", err)
	}
	return &journal{file: file}, nil
}

func (j *journal) write(e entry) {
	e.Time = seconds(time.Now())
	line, err := json.Marshal(e)
	if err != nil {
		panic(err) // an entry has nothing that JSON lacks
	}
	j.mu.Lock()
	defer j.mu.Unlock()
	if _, err := j.file.Write(append(line, '\n')); err != nil {
		slog.Error("the journal cannot be written", "error", err)
	}
}

func seconds(t time.Time) float64 { return float64(t.UnixMicro()) / 1e6 }

// answered fills in what a coordinator said.
func (e entry) answered(outcome farmv1.Outcome, message string, err error) entry {
	if err != nil {
		e.Message = status.Code(err).String() + ": " + status.Convert(err).Message()
		return e
	}
	e.Outcome = strings.ToLower(strings.TrimPrefix(outcome.String(), "OUTCOME_"))
	e.Message = message
	return e
}
