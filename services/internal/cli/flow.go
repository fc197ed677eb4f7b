package cli

import "metrofarm/services/internal/coordinator"

// Flow bounds what workers send; zero values mean defaults.
type Flow struct {
	// MergeBudget is the memory, in bytes, of batches that wait to be merged.
	MergeBudget int64
	// FilmsMemory is the memory, in bytes, that the films of all jobs together may take; 0: no bound.
	FilmsMemory int64
	// InboundBytes is what all workers together should deliver per second at most.
	InboundBytes int64
}

// share fills in what was not given by the memory that this process may use, 0 if that is not known.
func (f *Flow) share(memory int64, localWorkers int) {
	if memory == 0 {
		return
	}
	if f.MergeBudget == 0 {
		f.MergeBudget = min(coordinator.DefaultMergeBudget, memory/8)
	}
	if f.FilmsMemory == 0 {
		f.FilmsMemory = memory / 2
		if localWorkers > 0 {
			f.FilmsMemory = memory / 4
		}
	}
}

// sceneMemory is what the scenes of each local worker may take: half of the memory, shared out; 0 if
// there are none or it is not known.
func sceneMemory(memory int64, localWorkers int) int64 {
	if localWorkers == 0 {
		return 0
	}
	return memory / 2 / int64(localWorkers)
}

// flowFlags are those of serve that bound what workers send.
type flowFlags struct {
	flow Flow
}

func (l *flowFlags) register(f *flags) {
	f.Func("merge-budget", "`SIZE` of the memory for batches that wait to be merged, packed and unpacked; beyond it workers "+
		"wait; default 1GiB, but at most an eighth of the memory that there is", bytesInto(&l.flow.MergeBudget))
	f.Func("films-memory", "`SIZE` of the memory for the films and chains of all jobs, as estimated; jobs beyond it wait, a larger one is "+
		"refused; default half of the memory that there is (of the control group or the machine), a quarter beside --workers", bytesInto(&l.flow.FilmsMemory))
	f.Func("inbound-bytes", "`SIZE` that all workers together should deliver per second at most: the more workers, the longer "+
		"each collects before it delivers; default 64MiB", bytesInto(&l.flow.InboundBytes))
}
