package main

import (
	"runtime/debug"
	"testing"
)

func TestTheHeapKeepsToTheMemoryThatThereIs(t *testing.T) {
	before := debug.SetMemoryLimit(-1)
	defer debug.SetMemoryLimit(before)
	t.Setenv("GOMEMLIMIT", "123MiB")
	memory := limitMemory()
	if memory < 64<<20 {
		t.Fatalf("this machine has %d bytes", memory)
	}
	if got := debug.SetMemoryLimit(-1); got != before {
		t.Errorf("limit %d although GOMEMLIMIT says otherwise", got)
	}
}
