package coordinator_test

import (
	"time"

	"google.golang.org/grpc"
	"google.golang.org/grpc/backoff"
)

// fastReconnect keeps tests that restart the coordinator short.
func fastReconnect() grpc.ConnectParams {
	return grpc.ConnectParams{
		Backoff:           backoff.Config{BaseDelay: 5 * time.Millisecond, Multiplier: 1.2, MaxDelay: 50 * time.Millisecond},
		MinConnectTimeout: time.Second,
	}
}
