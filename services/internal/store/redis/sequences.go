package redis

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"strconv"

	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// createSequenceScript stores a sequence with its jobs.
//
//	KEYS[1]  sequence:ID
//	KEYS[2]  order
//	KEYS[3]  number
//	KEYS[4]  keys
//	KEYS[5]  leases
//	KEYS[6]  sequences
//	KEYS[7]  job:ID of the first job, and so on
//	ARGV[1]  id
//	ARGV[2]  sequence
//	ARGV[3]  owner
//	ARGV[4]  duration of the leases in milliseconds
//	ARGV[5]  idempotency key, may be empty
//	ARGV[6]  fingerprint of the request
//	ARGV[7]  id of the first job, ARGV[8] its record, and so on
//	returns  as luaKey
var createSequenceScript = goredis.NewScript(luaNow + luaKey + luaInsert + `
local count = (#ARGV - 6) / 2
local first = redis.call('INCRBY', KEYS[3], count) - count + 1
for i = 1, count do
  insert(KEYS[6 + i], ARGV[5 + 2 * i], ARGV[6 + 2 * i], string.format('%.0f', first + i - 1), '', ARGV[1])
end
number = string.format('%.0f', first)
redis.call('HSET', KEYS[1], 'id', ARGV[1], 'record', ARGV[2], 'number', number, 'left', count, 'key', key)
redis.call('ZADD', KEYS[6], number, ARGV[1])
if key ~= '' then redis.call('HSET', KEYS[4], key, ARGV[1] .. ' ' .. ARGV[6]) end
return {'created', number, ''}
`)

// CreateSequence implements store.Store.
func (s *Store) CreateSequence(ctx context.Context, c store.Claim, q store.Sequence, jobs []store.Record, key, fingerprint string) (store.Sequence, bool, error) {
	record, err := encode(q)
	if err != nil {
		return store.Sequence{}, false, wrap("create sequence", err)
	}
	keys := []string{s.sequenceKey(q.ID), s.key("order"), s.key("number"), s.key("keys"), s.key("leases"), s.key("sequences")}
	args := []any{q.ID, record, c.Owner, milliseconds(c.TTL), key, fingerprint}
	for _, r := range jobs {
		record, err := encode(r)
		if err != nil {
			return store.Sequence{}, false, wrap("create sequence", err)
		}
		keys, args = append(keys, s.jobKey(r.ID)), append(args, r.ID, record)
	}
	for {
		rest, err := s.run(ctx, createSequenceScript, keys, args...)
		if err != nil {
			return store.Sequence{}, false, wrap("create sequence", err)
		}
		id, created := q.ID, true
		if used := fmt.Sprint(rest[1]); used != "" {
			id, created = used, false
		}
		stored, err := s.Sequence(ctx, id)
		if !created && errors.Is(err, job.ErrNotFound) {
			continue // deleted meanwhile, and its key with it
		}
		return stored, created, err
	}
}

// readSequencesScript reads sequences with the states of their jobs. Those that are gone are left out. Which
// jobs it looks at the sequences say; their keys share the slot of all others.
//
//	KEYS[1]  sequence:ID of the first sequence, and so on
//	ARGV[1]  what comes before the id in the key of a job
//	returns  {'ok', record, number, {state, or empty if the job is gone, and so on}, and so on}
var readSequencesScript = goredis.NewScript(`
local answer = {'ok'}
for _, at in ipairs(KEYS) do
  local fields = redis.call('HMGET', at, 'record', 'number')
  if fields[1] then
    local states = {}
    for i, id in ipairs(cjson.decode(fields[1]).jobs) do
      states[i] = redis.call('HGET', ARGV[1] .. id, 'state') or ''
    end
    answer[#answer + 1] = fields[1]
    answer[#answer + 1] = fields[2]
    answer[#answer + 1] = states
  end
end
return answer
`)

func (s *Store) readSequences(ctx context.Context, ids []string) ([]store.Sequence, error) {
	if len(ids) == 0 {
		return nil, nil
	}
	keys := make([]string, len(ids))
	for i, id := range ids {
		keys[i] = s.sequenceKey(id)
	}
	rest, err := s.run(ctx, readSequencesScript, keys, s.jobKey(""))
	if err != nil {
		return nil, err
	}
	sequences := make([]store.Sequence, 0, len(ids))
	for ; len(rest) >= 3; rest = rest[3:] {
		q, err := decodeSequence(rest[0], rest[1], rest[2])
		if err != nil {
			return nil, err
		}
		sequences = append(sequences, q)
	}
	return sequences, nil
}

func decodeSequence(record, number, states any) (q store.Sequence, err error) {
	if err := json.Unmarshal([]byte(fmt.Sprint(record)), &q); err != nil {
		return q, err
	}
	if q.Number, err = strconv.ParseUint(fmt.Sprint(number), 10, 64); err != nil {
		return q, err
	}
	list, _ := states.([]any)
	q.States = make([]job.State, len(q.Jobs))
	for i := range q.States {
		q.States[i] = job.Deleted
		if i < len(list) && fmt.Sprint(list[i]) != "" {
			q.States[i] = job.State(fmt.Sprint(list[i]))
		}
	}
	return q, nil
}

// Sequence implements store.Store.
func (s *Store) Sequence(ctx context.Context, id string) (store.Sequence, error) {
	sequences, err := s.readSequences(ctx, []string{id})
	if err == nil && len(sequences) == 0 {
		err = job.ErrNotFound
	}
	if err != nil {
		return store.Sequence{}, fmt.Errorf("redis: get sequence %s: %w", id, err)
	}
	return sequences[0], nil
}

// Sequences implements store.Store.
func (s *Store) Sequences(ctx context.Context, before uint64, limit int) ([]store.Sequence, error) {
	var sequences []store.Sequence
	for len(sequences) < limit {
		ids, last, err := s.below(ctx, "sequences", before, limit-len(sequences))
		if err != nil || len(ids) == 0 {
			return sequences, wrap("list sequences", err)
		}
		page, err := s.readSequences(ctx, ids) // fewer if some were deleted meanwhile
		if err != nil {
			return nil, wrap("list sequences", err)
		}
		sequences = append(sequences, page...)
		before = last
	}
	return sequences, nil
}
