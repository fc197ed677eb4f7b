package cli

import (
	"fmt"
	"io"
	"math"
	"strconv"
	"strings"
	"time"

	"metrofarm/services/internal/job"
)

const barWidth = 24

// percent is floored, and 100 only for a job that is done.
func percent(s job.Snapshot) int {
	if s.State == job.Done {
		return 100
	}
	return max(0, min(99, int(math.Floor(100*s.Progress))))
}

// progressLine says in one line how a job is doing.
func progressLine(s job.Snapshot) string {
	parts := []string{fmt.Sprintf("%3d%%", percent(s)), phase(s)}
	if s.MutationsPerSecond > 0 && !s.State.Ended() {
		parts = append(parts, metric(s.MutationsPerSecond)+" mutations/s")
	}
	if s.RelMSE != nil {
		text := "relMSE " + short(*s.RelMSE)
		if s.RelMSEInterval != nil {
			text += " (" + short(s.RelMSEInterval.Low) + " to " + short(s.RelMSEInterval.High) + ")"
		}
		parts = append(parts, text)
	}
	if s.ETASeconds > 0 && !s.State.Ended() {
		parts = append(parts, "ETA "+duration(s.ETASeconds))
	}
	return strings.Join(parts, "  ")
}

func phase(s job.Snapshot) string {
	text := string(s.State)
	if s.State == job.Rendering {
		text = "round " + strconv.Itoa(s.RoundsDone+1)
	} else if s.State == job.Done {
		text = "done, " + count(s.RoundsDone, "round")
	}
	if s.Paused {
		text += " (paused)"
	}
	if s.Activity != "" && s.Activity != string(s.State) && !s.State.Ended() {
		text += ", " + s.Activity
	}
	return text
}

func count(n int, noun string) string {
	if n == 1 {
		return "1 " + noun
	}
	return strconv.Itoa(n) + " " + noun + "s"
}

func short(x float64) string { return strconv.FormatFloat(x, 'g', 2, 64) }

// metric formats a rate with three digits and a unit prefix.
func metric(x float64) string {
	for _, prefix := range []string{"", " k", " M", " G", " T"} {
		if x < 999.5 {
			return strconv.FormatFloat(x, 'g', 3, 64) + prefix
		}
		x /= 1000
	}
	return strconv.FormatFloat(x*1000, 'g', 3, 64) + " T"
}

func duration(seconds float64) string {
	d := time.Duration(math.Ceil(seconds)) * time.Second
	switch {
	case seconds > 99*3600:
		return "over 99h"
	case d >= time.Hour:
		return fmt.Sprintf("%dh%02dm", int(d.Hours()), int(d.Minutes())%60)
	case d >= time.Minute:
		return fmt.Sprintf("%dm%02ds", int(d.Minutes()), int(d.Seconds())%60)
	default:
		return fmt.Sprintf("%ds", int(d.Seconds()))
	}
}

// reporter shows progress: a bar that is redrawn on a terminal, else a line from time to time.
type reporter struct {
	w        io.Writer
	terminal bool
	shown    int    // width of the bar on the screen
	line     string // what was printed last
}

// interval between reports.
func (r *reporter) interval() time.Duration {
	if r.terminal {
		return 250 * time.Millisecond
	}
	return 5 * time.Second
}

func (r *reporter) report(s job.Snapshot) {
	line := progressLine(s)
	if !r.terminal {
		if line != r.line {
			fmt.Fprintln(r.w, line)
		}
		r.line = line
		return
	}
	filled := barWidth * percent(s) / 100
	bar := strings.Repeat("#", filled) + strings.Repeat(".", barWidth-filled)
	text := "[" + bar + "] " + line
	fmt.Fprintf(r.w, "\r%s%s", text, strings.Repeat(" ", max(0, r.shown-len(text))))
	r.shown = len(text)
}

// say prints a message of its own.
func (r *reporter) say(format string, values ...any) {
	r.clear()
	fmt.Fprintf(r.w, format+"\n", values...)
}

// clear removes the bar.
func (r *reporter) clear() {
	if r.shown > 0 {
		fmt.Fprintf(r.w, "\r%s\r", strings.Repeat(" ", r.shown))
		r.shown = 0
	}
}

// end leaves the last report on the screen.
func (r *reporter) end(s job.Snapshot) {
	r.report(s)
	if r.shown > 0 {
		fmt.Fprintln(r.w)
		r.shown = 0
	}
}
