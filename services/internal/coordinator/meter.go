package coordinator

import "time"

// meterWindow is the time over which rates are averaged: several batches of every worker.
const meterWindow = 15 * time.Second

// meter measures a rate of recent counts.
type meter struct {
	points []meterPoint
}

type meterPoint struct {
	at time.Time
	n  uint64
}

func (m *meter) add(n uint64, now time.Time) {
	m.trim(now)
	m.points = append(m.points, meterPoint{now, n})
}

func (m *meter) trim(now time.Time) {
	old := 0
	for old < len(m.points) && now.Sub(m.points[old].at) > meterWindow {
		old++
	}
	m.points = m.points[old:]
}

// rate per second. The first point only starts the clock: when its work began is unknown.
func (m *meter) rate(now time.Time) float64 {
	m.trim(now)
	if len(m.points) < 2 {
		return 0
	}
	var sum uint64
	for _, p := range m.points[1:] {
		sum += p.n
	}
	span := now.Sub(m.points[0].at).Seconds()
	if span <= 0 {
		return 0
	}
	return float64(sum) / span
}
