// Package redis keeps the store in a Redis server (5 or newer), for several coordinators. Every
// transition is one Lua script, so it happens whole or not at all, by the server's clock. It is
// durable on return if the server runs with appendonly yes and appendfsync always; with everysec, a
// crash of the server can lose its last second.
//
// Keys, all with one hash tag so that they share a slot of a cluster:
//
//	{prefix}:farm         id of the farm
//	{prefix}:number       counter, the number of the last job
//	{prefix}:order        sorted set, job ids by number
//	{prefix}:leases       sorted set, job ids by the end of their lease in milliseconds; 0 when released;
//	                      jobs that were released since they ended are not in it
//	{prefix}:keys         hash, idempotency key to "id fingerprint", of a job or a sequence
//	{prefix}:members      sorted set, member ids by the end of their membership in milliseconds
//	{prefix}:addresses    hash, member id to store.Member in JSON
//	{prefix}:job:ID       hash: record (store.Record in JSON), number, revision, ended ("1" or empty),
//	                      state, epoch, owner (empty when released), last (sequence of the last event), key,
//	                      sequence (id of the sequence that it is a frame of, or empty)
//	{prefix}:sequences    sorted set, ids of sequences by number
//	{prefix}:sequence:ID  hash: id, record (store.Sequence in JSON), number, left (how many of its jobs
//	                      there are), key
//	{prefix}:changes      stream of jobs at rest that were deleted or go on: fields id, deleted ("1" or empty)
//	{prefix}:events:ID    stream, ids are SEQUENCE-0, field "e" is job.Event in JSON
package redis

import (
	"context"
	"errors"
	"fmt"
	"log/slog"
	"net/url"
	"time"

	goredis "github.com/redis/go-redis/v9"

	"metrofarm/services/internal/store"
)

const (
	defaultPrefix = "metrofarm"
	// Bounds of one attempt.
	dialTimeout = time.Second
	readTimeout = 2 * time.Second
)

// Options of a store.
type Options struct {
	// Patience is how long a call tries again while the server cannot be reached; 0: 4 s.
	Patience time.Duration
	// Logger gets a warning if the server may lose what it confirmed; nil: discard.
	Logger *slog.Logger
}

// Store is a store.Store in a Redis server.
type Store struct {
	client   goredis.UniversalClient
	prefix   string
	patience time.Duration
	log      *slog.Logger
}

var _ store.Store = (*Store)(nil)

// Open connects to a server: redis://[[USER]:PASSWORD@]HOST[:PORT][/DB], rediss://... with TLS, or
// unix:///PATH[?db=N]. ?prefix=NAME keeps the jobs of several farms apart in one database.
func Open(ctx context.Context, address string, o Options) (*Store, error) {
	parsed, prefix, err := parse(address)
	if err != nil {
		return nil, err
	}
	s := New(goredis.NewClient(parsed), prefix, o)
	if err := s.greet(ctx); err != nil {
		return nil, errors.Join(fmt.Errorf("redis: connect to %s: %w", parsed.Addr, err), s.Close())
	}
	return s, nil
}

// Check tells what is wrong with an address, without connecting.
func Check(address string) error {
	_, _, err := parse(address)
	return err
}

func parse(address string) (o *goredis.Options, prefix string, err error) {
	u, err := url.Parse(address)
	if err != nil {
		return nil, "", errors.New("redis: not a URL") // without the address: it may hold a password
	}
	query := u.Query()
	prefix = query.Get("prefix")
	query.Del("prefix")
	u.RawQuery = query.Encode()
	if o, err = goredis.ParseURL(u.String()); err != nil {
		return nil, "", err
	}
	o.MaxRetries = -1 // run does it, for longer
	o.DialTimeout, o.ReadTimeout, o.WriteTimeout = dialTimeout, readTimeout, readTimeout
	o.DialerRetries = 1
	o.ContextTimeoutEnabled = true
	return o, prefix, nil
}

// New uses a client, which may be a cluster's. The client must not retry by itself.
func New(client goredis.UniversalClient, prefix string, o Options) *Store {
	s := &Store{client: client, prefix: prefix, patience: o.Patience, log: o.Logger}
	if s.prefix == "" {
		s.prefix = defaultPrefix
	}
	if s.patience == 0 {
		s.patience = 4 * time.Second
	}
	if s.log == nil {
		s.log = slog.New(slog.DiscardHandler)
	}
	return s
}

// Close closes the connections.
func (s *Store) Close() error { return s.client.Close() }

// greet waits for the server and looks at how it keeps things.
func (s *Store) greet(ctx context.Context) error {
	if err := s.try(ctx, func(ctx context.Context) error { return s.client.Ping(ctx).Err() }); err != nil {
		return err
	}
	for name, want := range map[string]string{
		"appendonly": "yes", "appendfsync": "always", "maxmemory-policy": "noeviction",
	} {
		got, err := s.client.ConfigGet(ctx, name).Result()
		if err != nil {
			return nil //nolint:nilerr // who may not read the configuration gets no advice
		}
		if got[name] != want {
			s.log.Warn("Redis may lose what it has confirmed", "setting", name, "is", got[name], "want", want)
		}
	}
	return nil
}

// key of a part of the store.
func (s *Store) key(name string) string { return "{" + s.prefix + "}:" + name }

func (s *Store) jobKey(id string) string    { return s.key("job:" + id) }
func (s *Store) eventsKey(id string) string { return s.key("events:" + id) }

func (s *Store) sequenceKey(id string) string { return s.key("sequence:" + id) }
