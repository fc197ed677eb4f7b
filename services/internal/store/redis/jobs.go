package redis

import (
	"context"
	"encoding/json"
	"errors"
	"fmt"
	"slices"
	"strconv"

	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/job"
	"metrofarm/services/internal/store"
)

// Every script that asks for the time begins with this: now is the server's clock in milliseconds.
const luaNow = `
local clock = redis.call('TIME')
local now = clock[1] * 1000 + math.floor(clock[2] / 1000)
`

// Scripts that must go on while the server's memory is used up (maxmemory) begin with this: they keep
// leases, or free memory. A server refuses what may take memory only as long as a script has written
// nothing, and this changes nothing: no key expires.
//
//	KEYS[1]  any key
const luaEvenFull = `
redis.call('PERSIST', KEYS[1])
`

// Every script that changes a job for its owner begins with this.
//
//	KEYS[1]  job:ID
//	ARGV[1]  epoch of the caller
const luaFence = `
local epoch = redis.call('HGET', KEYS[1], 'epoch')
if not epoch then return {'missing'} end
if epoch ~= ARGV[1] or redis.call('HGET', KEYS[1], 'owner') == '' then return {'fenced'} end
`

// Every script that creates something under an idempotency key begins with this. Repeated with the same
// id, it answers as the first time.
//
//	KEYS[1]  job:ID or sequence:ID
//	KEYS[4]  keys
//	ARGV[1]  id
//	ARGV[5]  idempotency key, may be empty
//	ARGV[6]  fingerprint of the request
//	returns  {'created', number, ''}, {'used', '', id of what has the key}, {'reused'}
const luaKey = `
local key = ARGV[5]
if key ~= '' then
  local used = redis.call('HGET', KEYS[4], key)
  if used then
    local gap = string.find(used, ' ', 1, true)
    local id = string.sub(used, 1, gap - 1)
    if string.sub(used, gap + 1) ~= ARGV[6] then return {'reused'} end
    if id ~= ARGV[1] then return {'used', '', id} end
  end
end
local number = redis.call('HGET', KEYS[1], 'number')
if number then return {'created', number, ''} end
`

// luaInsert stores a new job: its key, id, record and number, and the sequence that it is a frame of.
//
//	KEYS[2]  order
//	KEYS[5]  leases
//	ARGV[3]  owner
//	ARGV[4]  duration of the lease in milliseconds
const luaInsert = `
local function insert(at, id, record, number, key, sequence)
  redis.call('HSET', at, 'record', record, 'number', number, 'revision', '0', 'ended', '', 'state', 'queued',
    'epoch', '1', 'owner', ARGV[3], 'last', '0', 'key', key, 'sequence', sequence)
  redis.call('ZADD', KEYS[2], number, id)
  redis.call('ZADD', KEYS[5], now + ARGV[4], id)
end
`

// createScript stores a new job.
//
//	KEYS[1]  job:ID
//	KEYS[2]  order
//	KEYS[3]  number
//	KEYS[4]  keys
//	KEYS[5]  leases
//	ARGV[1]  id
//	ARGV[2]  record
//	ARGV[3]  owner
//	ARGV[4]  duration of the lease in milliseconds
//	ARGV[5]  idempotency key, may be empty
//	ARGV[6]  fingerprint of the request
//	returns  as luaKey
var createScript = goredis.NewScript(luaNow + luaKey + luaInsert + `
number = tostring(redis.call('INCR', KEYS[3]))
insert(KEYS[1], ARGV[1], ARGV[2], number, key, '')
if key ~= '' then redis.call('HSET', KEYS[4], key, ARGV[1] .. ' ' .. ARGV[6]) end
return {'created', number, ''}
`)

// CreateJob implements store.Store.
func (s *Store) CreateJob(ctx context.Context, c store.Claim, r store.Record, key, fingerprint string) (store.Record, bool, error) {
	record, err := encode(r)
	if err != nil {
		return store.Record{}, false, wrap("create job", err)
	}
	keys := []string{s.jobKey(r.ID), s.key("order"), s.key("number"), s.key("keys"), s.key("leases")}
	for {
		rest, err := s.run(ctx, createScript, keys, r.ID, record, c.Owner, milliseconds(c.TTL), key, fingerprint)
		if err != nil {
			return store.Record{}, false, wrap("create job", err)
		}
		if used := fmt.Sprint(rest[1]); used != "" {
			first, err := s.Job(ctx, used)
			if errors.Is(err, job.ErrNotFound) {
				continue // deleted meanwhile, and its key with it
			}
			return first.Record, false, err
		}
		r.Number, err = strconv.ParseUint(fmt.Sprint(rest[0]), 10, 64)
		return r, true, wrap("create job", err)
	}
}

// updateScript replaces a record and appends events, those that are not there yet: a caller that did
// not hear of an update's success sends its events again. That a job which had ended goes on is noted
// among the changes.
//
//	KEYS[1]  job:ID
//	KEYS[2]  events:ID
//	KEYS[3]  changes
//	ARGV[1]  epoch of the caller
//	ARGV[2]  revision
//	ARGV[3]  '1' if the job has ended, else empty
//	ARGV[4]  record
//	ARGV[5]  how many events to keep
//	ARGV[6]  how many changes to keep
//	ARGV[7]  id
//	ARGV[8]  state
//	ARGV[9]  sequence of the first event, ARGV[10] the event, and so on
//	returns  {'ok'}, {'fenced'}, {'missing'}
var updateScript = goredis.NewScript(luaFence + `
local revision, stored = tonumber(ARGV[2]), tonumber(redis.call('HGET', KEYS[1], 'revision'))
if revision < stored then return {'fenced'} end
if revision == stored then return {'ok'} end
if ARGV[3] == '' and redis.call('HGET', KEYS[1], 'ended') == '1' then
  redis.call('XADD', KEYS[3], 'MAXLEN', '~', ARGV[6], '*', 'id', ARGV[7], 'deleted', '')
end
redis.call('HSET', KEYS[1], 'record', ARGV[4], 'revision', ARGV[2], 'ended', ARGV[3], 'state', ARGV[8])
local last = tonumber(redis.call('HGET', KEYS[1], 'last'))
for i = 9, #ARGV, 2 do
  local sequence = tonumber(ARGV[i])
  if sequence > last then
    redis.call('XADD', KEYS[2], ARGV[i] .. '-0', 'e', ARGV[i + 1])
    redis.call('HSET', KEYS[1], 'last', ARGV[i])
    last = sequence
  end
end
if #ARGV > 8 then redis.call('XTRIM', KEYS[2], 'MAXLEN', ARGV[5]) end
return {'ok'}
`)

// UpdateJob implements store.Store.
func (s *Store) UpdateJob(ctx context.Context, epoch uint64, r store.Record, events []job.Event) error {
	record, err := encode(r)
	if err != nil {
		return wrapJob("update job", r.ID, err)
	}
	ended := ""
	if r.State.Ended() {
		ended = "1"
	}
	args := []any{epoch, r.Revision, ended, record, store.MaxEvents, store.MaxChanges, r.ID, string(r.State)}
	for _, e := range events {
		text, err := encode(e)
		if err != nil {
			return wrapJob("update job", r.ID, err)
		}
		args = append(args, e.Sequence, text)
	}
	keys := []string{s.jobKey(r.ID), s.eventsKey(r.ID), s.key("changes")}
	_, err = s.run(ctx, updateScript, keys, args...)
	return wrapJob("update job", r.ID, err)
}

// deleteScript removes a job with all that belongs to it, and the sequence that has no other job.
//
//	KEYS[1]  job:ID
//	KEYS[2]  events:ID
//	KEYS[3]  order
//	KEYS[4]  leases
//	KEYS[5]  keys
//	KEYS[6]  changes
//	KEYS[7]  sequences
//	KEYS[8]  sequence:ID, if the job is a frame of one
//	ARGV[1]  epoch of the caller
//	ARGV[2]  id
//	ARGV[3]  how many changes to keep
//	returns  {'ok'}, {'fenced'}, {'missing'}
var deleteScript = goredis.NewScript(luaEvenFull + luaFence + `
local key = redis.call('HGET', KEYS[1], 'key')
if key ~= '' then redis.call('HDEL', KEYS[5], key) end
redis.call('ZREM', KEYS[3], ARGV[2])
redis.call('ZREM', KEYS[4], ARGV[2])
redis.call('DEL', KEYS[1], KEYS[2])
redis.call('XADD', KEYS[6], 'MAXLEN', '~', ARGV[3], '*', 'id', ARGV[2], 'deleted', '1')
if KEYS[8] and redis.call('HINCRBY', KEYS[8], 'left', -1) <= 0 then
  local sequence = redis.call('HMGET', KEYS[8], 'id', 'key')
  if sequence[2] ~= '' then redis.call('HDEL', KEYS[5], sequence[2]) end
  redis.call('ZREM', KEYS[7], sequence[1])
  redis.call('DEL', KEYS[8])
end
return {'ok'}
`)

// DeleteJob implements store.Store. A deletion whose answer was lost succeeds when it is repeated
// within this call; a later call finds no job.
func (s *Store) DeleteJob(ctx context.Context, epoch uint64, id string) error {
	keys := []string{
		s.jobKey(id), s.eventsKey(id), s.key("order"), s.key("leases"), s.key("keys"), s.key("changes"), s.key("sequences"),
	}
	var sequence string // a job never changes it
	err := s.try(ctx, func(ctx context.Context) (err error) {
		if sequence, err = s.client.HGet(ctx, s.jobKey(id), "sequence").Result(); errors.Is(err, goredis.Nil) {
			err = nil // the job is gone, or from before there were sequences
		}
		return err
	})
	if err != nil {
		return wrapJob("delete job", id, err)
	}
	if sequence != "" {
		keys = append(keys, s.sequenceKey(sequence))
	}
	err = s.runOnce(ctx, job.ErrNotFound, deleteScript, keys, epoch, id, store.MaxChanges)
	return wrapJob("delete job", id, err)
}

// readScript reads jobs. Those that are gone are left out.
//
//	KEYS[1]  leases
//	KEYS[2]  addresses
//	KEYS[3]  job:ID of the first job, and so on
//	ARGV[1]  id of the first job, and so on
//	returns  {'ok', record, number, member that owns the job or empty, and so on}
var readScript = goredis.NewScript(luaNow + `
local answer = {'ok'}
for i, id in ipairs(ARGV) do
  local fields = redis.call('HMGET', KEYS[i + 2], 'record', 'number', 'owner')
  if fields[1] then
    local lease, member = redis.call('ZSCORE', KEYS[1], id), false
    if lease and tonumber(lease) > now then member = redis.call('HGET', KEYS[2], fields[3]) end
    answer[#answer + 1] = fields[1]
    answer[#answer + 1] = fields[2]
    answer[#answer + 1] = member or ''
  end
end
return answer
`)

// readAtOnce is how many jobs an answer has at most. Records may have hundreds of kilobytes, and an answer
// must come within readTimeout.
const readAtOnce = 32

func (s *Store) read(ctx context.Context, ids []string) ([]store.Owned, error) {
	jobs := make([]store.Owned, 0, len(ids))
	for some := range slices.Chunk(ids, readAtOnce) {
		read, err := s.readSome(ctx, some)
		if err != nil {
			return nil, err
		}
		jobs = append(jobs, read...)
	}
	return jobs, nil
}

func (s *Store) readSome(ctx context.Context, ids []string) ([]store.Owned, error) {
	keys, args := []string{s.key("leases"), s.key("addresses")}, make([]any, 0, len(ids))
	for _, id := range ids {
		keys, args = append(keys, s.jobKey(id)), append(args, id)
	}
	rest, err := s.run(ctx, readScript, keys, args...)
	if err != nil {
		return nil, err
	}
	jobs := make([]store.Owned, 0, len(ids))
	for ; len(rest) >= 3; rest = rest[3:] {
		var j store.Owned
		if err := decodeRecord(&j.Record, rest[0], rest[1]); err != nil {
			return nil, err
		}
		if owner := fmt.Sprint(rest[2]); owner != "" {
			if err := json.Unmarshal([]byte(owner), &j.Owner); err != nil {
				return nil, err
			}
		}
		jobs = append(jobs, j)
	}
	return jobs, nil
}

// decodeRecord also sets the number, which a record does not know before it is stored.
func decodeRecord(r *store.Record, record, number any) error {
	if err := json.Unmarshal([]byte(fmt.Sprint(record)), r); err != nil {
		return err
	}
	var err error
	r.Number, err = strconv.ParseUint(fmt.Sprint(number), 10, 64)
	return err
}

// Job implements store.Store.
func (s *Store) Job(ctx context.Context, id string) (store.Owned, error) {
	jobs, err := s.read(ctx, []string{id})
	if err == nil && len(jobs) == 0 {
		err = job.ErrNotFound
	}
	if err != nil {
		return store.Owned{}, wrapJob("get job", id, err)
	}
	return jobs[0], nil
}

// JobsByID implements store.Store.
func (s *Store) JobsByID(ctx context.Context, ids []string) ([]store.Owned, error) {
	jobs, err := s.read(ctx, ids)
	return jobs, wrap("get jobs", err)
}

// Jobs implements store.Store.
func (s *Store) Jobs(ctx context.Context, before uint64, limit int) ([]store.Owned, error) {
	var jobs []store.Owned
	for len(jobs) < limit {
		names, last, err := s.below(ctx, "order", before, limit-len(jobs))
		if err != nil || len(names) == 0 {
			return jobs, wrap("list jobs", err)
		}
		page, err := s.read(ctx, names) // fewer if some were deleted meanwhile
		if err != nil {
			return nil, wrap("list jobs", err)
		}
		jobs = append(jobs, page...)
		before = last
	}
	return jobs, nil
}

// below lists up to limit members of a sorted set with numbers below before, the last first, and the
// number of the last one listed.
func (s *Store) below(ctx context.Context, set string, before uint64, limit int) (names []string, last uint64, err error) {
	most := "+inf"
	if before > 0 {
		most = "(" + strconv.FormatUint(before, 10)
	}
	err = s.try(ctx, func(ctx context.Context) error {
		members, err := s.client.ZRevRangeByScoreWithScores(ctx, s.key(set),
			&goredis.ZRangeBy{Min: "-inf", Max: most, Count: int64(limit)}).Result()
		names = make([]string, len(members))
		for i, z := range members {
			names[i], last = fmt.Sprint(z.Member), uint64(z.Score)
		}
		return err
	})
	return names, last, err
}

// Events implements store.Store.
func (s *Store) Events(ctx context.Context, id string, after uint64) ([]job.Event, error) {
	if after == ^uint64(0) {
		return nil, nil
	}
	var entries []goredis.XMessage
	err := s.try(ctx, func(ctx context.Context) (err error) {
		entries, err = s.client.XRange(ctx, s.eventsKey(id), strconv.FormatUint(after+1, 10), "+").Result()
		return err
	})
	if err != nil {
		return nil, wrapJob("events of job", id, err)
	}
	events := make([]job.Event, len(entries))
	for i, entry := range entries {
		if err := json.Unmarshal([]byte(fmt.Sprint(entry.Values["e"])), &events[i]); err != nil {
			return nil, wrapJob("events of job", id, err)
		}
	}
	return events, nil
}

// firstMark is before all entries of a stream.
const firstMark = "0-0"

// Changes implements store.Store. A mark is the id of the last entry.
func (s *Store) Changes(ctx context.Context, mark string) ([]store.Change, string, error) {
	if mark == "" {
		mark, err := s.lastChange(ctx)
		return nil, mark, wrap("changes", err)
	}
	var entries []goredis.XMessage
	err := s.try(ctx, func(ctx context.Context) (err error) {
		entries, err = s.client.XRange(ctx, s.key("changes"), mark, "+").Result()
		return err
	})
	if err != nil {
		return nil, "", wrap("changes", err)
	}
	var changes []store.Change
	for _, entry := range entries {
		if entry.ID != mark {
			changes = append(changes, store.Change{ID: fmt.Sprint(entry.Values["id"]), Deleted: entry.Values["deleted"] == "1"})
		}
	}
	if len(entries) > 0 {
		mark = entries[len(entries)-1].ID
	}
	return changes, mark, nil
}

func (s *Store) lastChange(ctx context.Context) (string, error) {
	var last []goredis.XMessage
	err := s.try(ctx, func(ctx context.Context) (err error) {
		last, err = s.client.XRevRangeN(ctx, s.key("changes"), "+", "-", 1).Result()
		return err
	})
	if err != nil || len(last) == 0 {
		return firstMark, err
	}
	return last[0].ID, nil
}
