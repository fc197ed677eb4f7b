package redis

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"slices"
	"strings"
	"time"

	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Pauses between attempts, doubling.
const (
	firstPause = 20 * time.Millisecond
	lastPause  = 500 * time.Millisecond
)

// outages begin the replies of a server that will serve later.
var outages = []string{
	"LOADING", "READONLY", "MASTERDOWN", "CLUSTERDOWN", "TRYAGAIN", "NOREPLICAS", "MISCONF", "OOM",
	"BUSY", "UNBLOCKED", "max number of clients",
}

// try repeats an attempt while the server cannot be reached, as long as patience and ctx allow. An
// attempt whose answer was lost may have had its effect: what it does must bear repetition.
func (s *Store) try(ctx context.Context, attempt func(context.Context) error) error {
	ctx, cancel := context.WithTimeout(ctx, s.patience)
	defer cancel()
	for pause := firstPause; ; pause = min(2*pause, lastPause) {
		err := attempt(ctx)
		if err == nil || !unavailable(err) {
			return err
		}
		select {
		case <-time.After(pause):
		case <-ctx.Done():
			return fmt.Errorf("%w: %w", store.ErrUnavailable, err)
		}
	}
}

// unavailable tells a connection that failed, or a server that is not ready, from an answer.
func unavailable(err error) bool {
	if errors.Is(err, goredis.ErrClosed) {
		return false
	}
	var reply goredis.Error
	if !errors.As(err, &reply) {
		return true
	}
	text := strings.TrimPrefix(reply.Error(), "ERR ")                  // some servers put it before all
	if _, inner, found := strings.Cut(text, "@user_script: "); found { // of a command in a script, before Redis 7
		_, text, _ = strings.Cut(inner, ": -")
	}
	return slices.ContainsFunc(outages, func(prefix string) bool { return strings.HasPrefix(text, prefix) })
}

// run runs a script. Its answer begins with how it went; what follows is returned.
func (s *Store) run(ctx context.Context, script *goredis.Script, keys []string, args ...any) (rest []any, err error) {
	rest, _, err = s.count(ctx, script, keys, args...)
	return rest, err
}

// runOnce is run for a script that cannot have its effect twice: done is what it says the second
// time, which is a success if only the answer of the first was lost.
func (s *Store) runOnce(ctx context.Context, done error, script *goredis.Script, keys []string, args ...any) error {
	_, attempts, err := s.count(ctx, script, keys, args...)
	if attempts > 1 && errors.Is(err, done) {
		return nil
	}
	return err
}

func (s *Store) count(ctx context.Context, script *goredis.Script, keys []string, args ...any) (rest []any, attempts int, err error) {
	var answer []any
	err = s.try(ctx, func(ctx context.Context) error {
		attempts++
		var err error
		answer, err = script.Run(ctx, s.client, keys, args...).Slice()
		return err
	})
	if err != nil {
		return nil, attempts, err
	}
	if len(answer) == 0 {
		return nil, attempts, errors.New("a script without an answer")
	}
	return answer[1:], attempts, verdicts[fmt.Sprint(answer[0])]
}

// verdicts of scripts; anything else went well.
var verdicts = map[string]error{
	"fenced":  store.ErrFenced,
	"missing": job.ErrNotFound,
	"owned":   store.ErrOwned,
	"reused":  store.ErrKeyReused,
}

// encode makes JSON of what is to be stored.
func encode(v any) ([]byte, error) {
	content, err := json.Marshal(v)
	if err != nil {
		return nil, fmt.Errorf("%w: %w", store.ErrNotJSON, err)
	}
	return content, nil
}

func wrap(what string, err error) error {
	if err == nil {
		return nil
	}
	return fmt.Errorf("redis: %s: %w", what, err)
}

func wrapJob(what, id string, err error) error {
	if err == nil {
		return nil
	}
	return fmt.Errorf("redis: %s %s: %w", what, id, err)
}

func milliseconds(d time.Duration) int64 { return d.Milliseconds() }
