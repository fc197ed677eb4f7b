package cli

// Flow bounds what workers send; zero values mean defaults.
type Flow struct {
	// MergeBudget is the memory, in bytes, of batches that wait to be merged.
	MergeBudget int64
	// InboundBytes is what all workers together should deliver per second at most.
	InboundBytes int64
}

// flowFlags are those of serve that bound what workers send.
type flowFlags struct {
	flow Flow
}

func (l *flowFlags) register(f *flags) {
	f.Func("merge-budget", "`SIZE` of the memory for batches that wait to be merged, packed and unpacked; beyond it workers "+
		"wait; default 1GiB", bytesInto(&l.flow.MergeBudget))
	f.Func("inbound-bytes", "`SIZE` that all workers together should deliver per second at most: the more workers, the longer "+
		"each collects before it delivers; default 64MiB", bytesInto(&l.flow.InboundBytes))
}
