package redis

import (
	"context"
	"errors"

	goredis "github.com/redis/go-redis/v9"
)

// farmScript replaces the id of the farm.
//
//	KEYS[1]  farm
//	ARGV[1]  id that it must have
//	ARGV[2]  id to have
//	returns  {'ok', id that it has then}
var farmScript = goredis.NewScript(`
local now = redis.call('GET', KEYS[1]) or ''
if now == ARGV[1] and now ~= ARGV[2] then
  redis.call('SET', KEYS[1], ARGV[2])
  now = ARGV[2]
end
return {'ok', now}
`)

// SwapFarm implements store.Store.
func (s *Store) SwapFarm(ctx context.Context, old, next string) (now string, err error) {
	rest, err := s.run(ctx, farmScript, []string{s.key("farm")}, old, next)
	if err == nil && len(rest) != 1 {
		err = errors.New("an answer without the id")
	}
	if err != nil {
		return "", wrap("id of the farm", err)
	}
	return texts(rest)[0], nil
}
