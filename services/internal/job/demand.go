package job

// segmentsPerWorker is how much of a round keeps one worker busy long enough to be worth a start.
const segmentsPerWorker = 16

// WantedWorkers is how many workers the job could use: none when it cannot run, else one per so many
// segments of a whole round. What is left of the round would make the number fall to one at each
// round's end.
func (s Snapshot) WantedWorkers() int {
	if s.State.Ended() || s.Paused || s.WaitingForMemory {
		return 0
	}
	return max(1, (s.RoundSegments+segmentsPerWorker-1)/segmentsPerWorker)
}
