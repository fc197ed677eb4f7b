package redis

import (
	"context"
	"encoding/json"
	"fmt"
	"slices"
	"strconv"
	"strings"
	"time"

	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/store"
)

// beatScript keeps a member and renews its leases. It forgets members whose time has run out.
//
//	KEYS[1]  members
//	KEYS[2]  addresses
//	KEYS[3]  leases
//	KEYS[4]  job:ID of the first held job, and so on
//	ARGV[1]  id of the member
//	ARGV[2]  member
//	ARGV[3]  duration of membership and leases in milliseconds
//	ARGV[4]  id of the first held job, ARGV[5] its epoch, and so on
//	returns  {'ok', id of a job that is lost, and so on}
var beatScript = goredis.NewScript(luaEvenFull + luaNow + `
for _, gone in ipairs(redis.call('ZRANGEBYSCORE', KEYS[1], '-inf', now)) do
  redis.call('ZREM', KEYS[1], gone)
  redis.call('HDEL', KEYS[2], gone)
end
redis.call('ZADD', KEYS[1], now + ARGV[3], ARGV[1])
redis.call('HSET', KEYS[2], ARGV[1], ARGV[2])
local answer = {'ok'}
for i = 4, #ARGV, 2 do
  local job = redis.call('HMGET', KEYS[i / 2 + 2], 'epoch', 'owner')
  if job[1] == ARGV[i + 1] and job[2] == ARGV[1] then
    redis.call('ZADD', KEYS[3], now + ARGV[3], ARGV[i])
  else
    answer[#answer + 1] = ARGV[i]
  end
end
return answer
`)

// Beat implements store.Store.
func (s *Store) Beat(ctx context.Context, m store.Member, ttl time.Duration, held map[string]uint64) (lost []string, err error) {
	text, err := json.Marshal(m)
	if err != nil {
		return nil, wrap("beat", err)
	}
	keys := []string{s.key("members"), s.key("addresses"), s.key("leases")}
	args := []any{m.ID, text, milliseconds(ttl)}
	keys, args = s.heldJobs(keys, args, held)
	rest, err := s.run(ctx, beatScript, keys, args...)
	return texts(rest), wrap("beat", err)
}

func (s *Store) heldJobs(keys []string, args []any, held map[string]uint64) ([]string, []any) {
	for id, epoch := range held {
		keys, args = append(keys, s.jobKey(id)), append(args, id, epoch)
	}
	return keys, args
}

func texts(values []any) []string {
	var all []string
	for _, v := range values {
		all = append(all, fmt.Sprint(v))
	}
	return all
}

// leaveScript ends a membership and releases what the member still owns.
//
//	KEYS[1]  members
//	KEYS[2]  addresses
//	KEYS[3]  leases
//	KEYS[4]  job:ID of the first held job, and so on
//	ARGV[1]  id of the member
//	ARGV[2]  id of the first held job, ARGV[3] its epoch, and so on
//	returns  {'ok'}
var leaveScript = goredis.NewScript(luaEvenFull + `
redis.call('ZREM', KEYS[1], ARGV[1])
redis.call('HDEL', KEYS[2], ARGV[1])
for i = 2, #ARGV, 2 do
  local key = KEYS[i / 2 + 3]
  local job = redis.call('HMGET', key, 'epoch', 'owner')
  if job[1] == ARGV[i + 1] and job[2] == ARGV[1] then
    redis.call('HSET', key, 'owner', '')
    redis.call('ZADD', KEYS[3], 0, ARGV[i])
  end
end
return {'ok'}
`)

// Leave implements store.Store.
func (s *Store) Leave(ctx context.Context, member string, held map[string]uint64) error {
	keys, args := s.heldJobs([]string{s.key("members"), s.key("addresses"), s.key("leases")}, []any{member}, held)
	_, err := s.run(ctx, leaveScript, keys, args...)
	return wrap("leave", err)
}

// membersScript lists the members.
//
//	KEYS[1]  members
//	KEYS[2]  addresses
//	returns  {'ok', member, and so on}
var membersScript = goredis.NewScript(luaNow + `
local answer = {'ok'}
for _, id in ipairs(redis.call('ZRANGEBYSCORE', KEYS[1], '(' .. string.format('%.0f', now), '+inf')) do
  answer[#answer + 1] = redis.call('HGET', KEYS[2], id)
end
return answer
`)

// Members implements store.Store.
func (s *Store) Members(ctx context.Context) ([]store.Member, error) {
	rest, err := s.run(ctx, membersScript, []string{s.key("members"), s.key("addresses")})
	if err != nil {
		return nil, wrap("list members", err)
	}
	members := make([]store.Member, len(rest))
	for i, text := range texts(rest) {
		if err := json.Unmarshal([]byte(text), &members[i]); err != nil {
			return nil, wrap("list members", err)
		}
	}
	slices.SortFunc(members, func(a, b store.Member) int { return strings.Compare(a.ID, b.ID) })
	return members, nil
}

// releaseScript gives a job up. One that has ended leaves the leases for good.
//
//	KEYS[1]  job:ID
//	KEYS[2]  leases
//	ARGV[1]  epoch of the caller
//	ARGV[2]  id
//	returns  {'ok'}, {'fenced'}, {'missing'}
var releaseScript = goredis.NewScript(luaEvenFull + luaFence + `
redis.call('HSET', KEYS[1], 'owner', '')
if redis.call('HGET', KEYS[1], 'ended') == '1' then
  redis.call('ZREM', KEYS[2], ARGV[2])
else
  redis.call('ZADD', KEYS[2], 0, ARGV[2])
end
return {'ok'}
`)

// Release implements store.Store.
func (s *Store) Release(ctx context.Context, epoch uint64, id string) error {
	err := s.runOnce(ctx, store.ErrFenced, releaseScript, []string{s.jobKey(id), s.key("leases")}, epoch, id)
	return wrapJob("release job", id, err)
}

// waitingScript lists the jobs whose lease has run out or was released.
//
//	KEYS[1]  leases
//	returns  {'ok', id, and so on}
var waitingScript = goredis.NewScript(luaNow + `
local answer = {'ok'}
for _, id in ipairs(redis.call('ZRANGEBYSCORE', KEYS[1], '-inf', now)) do
  answer[#answer + 1] = id
end
return answer
`)

// Waiting implements store.Store.
func (s *Store) Waiting(ctx context.Context) ([]string, error) {
	rest, err := s.run(ctx, waitingScript, []string{s.key("leases")})
	return texts(rest), wrap("list waiting jobs", err)
}

// acquireScript makes the caller the owner of a job, unless another's lease lasts. Repeated, it
// raises the epoch again: the caller goes by the last answer.
//
//	KEYS[1]  job:ID
//	KEYS[2]  leases
//	ARGV[1]  id
//	ARGV[2]  id of the member
//	ARGV[3]  duration of the lease in milliseconds
//	returns  {'ok', epoch, record, number}, {'missing'}, {'owned'}
var acquireScript = goredis.NewScript(luaEvenFull + luaNow + `
local job = redis.call('HMGET', KEYS[1], 'owner', 'record', 'number')
if not job[2] then return {'missing'} end
local lease = redis.call('ZSCORE', KEYS[2], ARGV[1])
if lease and tonumber(lease) > now and job[1] ~= ARGV[2] then return {'owned'} end
redis.call('HSET', KEYS[1], 'owner', ARGV[2])
redis.call('ZADD', KEYS[2], now + ARGV[3], ARGV[1])
return {'ok', redis.call('HINCRBY', KEYS[1], 'epoch', 1), job[2], job[3]}
`)

// Acquire implements store.Store.
func (s *Store) Acquire(ctx context.Context, c store.Claim, id string) (r store.Record, epoch uint64, err error) {
	rest, err := s.run(ctx, acquireScript, []string{s.jobKey(id), s.key("leases")}, id, c.Owner, milliseconds(c.TTL))
	if err == nil {
		err = decodeRecord(&r, rest[1], rest[2])
	}
	if err == nil {
		epoch, err = strconv.ParseUint(fmt.Sprint(rest[0]), 10, 64)
	}
	return r, epoch, wrapJob("acquire job", id, err)
}
