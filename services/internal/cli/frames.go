package cli

import (
	"cmp"
	"context"
	"crypto/rand"
	"errors"
	"fmt"
	"io"
	"path/filepath"
	"strconv"
	"strings"
	"time"

	"metrofarm/services/internal/api"
	"metrofarm/services/internal/client"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/sequence"
)

// frameFlags are the flags that make a sequence of a job.
type frameFlags struct {
	frames job.Frames
	given  bool
}

// framesFlag is the flag of the range, the one that asks for a sequence.
const framesFlag = "frames"

func (r *frameFlags) register(f *flags) {
	f.Func(framesFlag, "`FIRST-LAST`: render these frames, one image each; the names of the outputs have #### where the number goes",
		func(text string) error { return r.parseRange(text) })
	for _, option := range job.FrameOptions() {
		registerOption(f, option, &r.frames, nil)
	}
}

func (r *frameFlags) parseRange(text string) error {
	first, last, isRange := strings.Cut(text, "-")
	if !isRange {
		last = first
	}
	var errs [2]error
	r.frames.Start, errs[0] = strconv.Atoi(first)
	r.frames.End, errs[1] = strconv.Atoi(last)
	if errors.Join(errs[:]...) != nil {
		return errors.New("want FIRST-LAST, for example 1-48, or one number")
	}
	r.given = true
	return nil
}

// check the flags, with what else makes up the job and where its images go.
func (r *frameFlags) check(request job.Request, outputs ...string) error {
	if !r.given {
		for _, option := range job.FrameOptions() {
			if option.Set(&r.frames) {
				return usagef("--%s: belongs to --%s", option.Flag, framesFlag)
			}
		}
		return nil
	}
	for _, path := range outputs {
		if path != "" && !strings.Contains(filepath.Base(path), "#") {
			return usagef("%s has no # for the frame's number: with --%s name files such as out.####.exr", path, framesFlag)
		}
	}
	s := job.SequenceRequest{Job: withScene(request), Frames: r.frames}
	return asUsage(s.Validate())
}

// framePath is the name of a frame's file: its number, with leading zeros, in the place of the last #s.
func framePath(pattern string, number int) string {
	end := strings.LastIndexByte(pattern, '#') + 1
	if end == 0 {
		return pattern
	}
	begin := len(strings.TrimRight(pattern[:end], "#"))
	return fmt.Sprintf("%s%0*d%s", pattern[:begin], end-begin, number, pattern[end:])
}

// frameFollower watches the frames of a sequence one after the other, and writes each once it has ended.
type frameFollower struct {
	follower // of each frame, without its id
	write    func(ctx context.Context, number int, s job.Snapshot) error
	// cancel ends the frames that have not ended.
	cancel func(ctx context.Context) error
}

// follow goes on with the next frame when one has failed. An interrupt makes the frame under way the
// last, and its round the last of it.
func (f *frameFollower) follow(ctx context.Context, frames []job.Frame) error {
	var first error
	failed := 0
	for i, frame := range frames {
		f.reporter.say("frame %d (%d of %d)", frame.Number, i+1, len(frames))
		watch := f.follower
		watch.id = frame.Job
		snapshot, err := watch.follow(ctx)
		if err == nil {
			err = f.write(ctx, frame.Number, snapshot)
		}
		if err != nil && !snapshot.State.Ended() {
			return errors.Join(err, f.cancel(context.WithoutCancel(ctx)))
		}
		if err != nil {
			err = fmt.Errorf("frame %d: %w", frame.Number, err)
			f.reporter.say("%v", err)
			failed++
			if first == nil {
				first = err
			}
		}
		if watch.interrupted && i+1 < len(frames) {
			err := fmt.Errorf("interrupted: %s not rendered", count(len(frames)-i-1, "frame"))
			return errors.Join(first, err, f.cancel(ctx))
		}
	}
	if failed > 1 {
		return fmt.Errorf("%d of %d frames failed, the first of them: %w", failed, len(frames), first)
	}
	return first
}

// renderFrames renders a sequence on this machine.
func (r *renderFlags) renderFrames(ctx context.Context, env Env, farm Farm, show *reporter) error {
	service := farm.Service()
	q, err := service.SubmitSequence(ctx, job.SequenceRequest{Job: r.request, Frames: r.frames}, "")
	if err != nil {
		return asUsage(err)
	}
	watch := &frameFollower{
		follower: follower{source: service, reporter: show, interrupts: env.Interrupts, failed: farm.Failed()},
		write: func(ctx context.Context, number int, s job.Snapshot) error {
			at := *r
			at.out, at.png, at.stats = framePath(r.out, number), framePath(r.png, number), framePath(r.stats, number)
			return at.fetch(ctx, service, s)
		},
		cancel: func(ctx context.Context) error { return cancelFrames(ctx, service, q.ID) },
	}
	return watch.follow(ctx, q.Frames)
}

func cancelFrames(ctx context.Context, service api.Service, id string) error {
	_, err := sequence.Cancel(ctx, service, id)
	return err
}

// submitFrames sends a sequence to a server. Requires: request names the scene.
func (s *submitFlags) submitFrames(ctx context.Context, env Env, c *client.Client) error {
	if s.key == "" {
		s.key = rand.Text()
	}
	q, err := c.SubmitSequence(ctx, job.SequenceRequest{Job: s.request, Frames: s.frames}, s.key)
	if err != nil {
		return err
	}
	if !s.wait && s.out == "" {
		return s.printSequence(env, q)
	}
	fmt.Fprintf(env.Stderr, "sequence %s\n", q.ID)
	watch := &frameFollower{
		follower: follower{source: c, interrupts: env.Interrupts, reporter: &reporter{w: env.Stderr, terminal: env.Terminal}},
		write: func(ctx context.Context, number int, snapshot job.Snapshot) error {
			return s.download(ctx, c, snapshot.ID, framePath(s.out, number))
		},
		cancel: func(ctx context.Context) error {
			_, err := c.ActOnSequence(ctx, q.ID, "cancel")
			return err
		},
	}
	if err := watch.follow(ctx, q.Frames); err != nil {
		return err
	}
	if q, err = c.Sequence(ctx, q.ID); err != nil {
		return err
	}
	return s.printSequence(env, q)
}

func (s *submitFlags) printSequence(env Env, q job.Sequence) error {
	if s.json {
		return writeJSON(env.Stdout, q)
	}
	_, err := fmt.Fprintln(env.Stdout, q.ID)
	return err
}

func listSequences(ctx context.Context, env Env, arguments []string) error {
	limit := 0
	r, c, _, err := remoteCommand(env, "sequences", arguments, 0, 0, func(f *flags) {
		f.IntVar(&limit, "limit", 20, "show at most `N` sequences; 0: all")
	})
	if err != nil {
		return ignoreHelp(err)
	}
	sequences, err := c.Sequences(ctx, limit)
	if err != nil {
		return err
	}
	if r.json {
		return writeJSON(env.Stdout, sequences)
	}
	return table(env.Stdout, "ID\tNAME\tUSER\tFRAMES\tSTATE\tCREATED", func(w io.Writer) {
		for i := range sequences {
			q := &sequences[i]
			fmt.Fprintf(w, "%s\t%s\t%s\t%s\t%s\t%s\n", q.ID, q.Request.Job.Name, cmp.Or(q.User, "-"), rangeText(q.Request.Frames),
				sequenceText(q), q.CreatedAt.Local().Format(time.DateTime))
		}
	})
}

// rangeText names the frames, with the step where it is not 1.
func rangeText(f job.Frames) string {
	text := fmt.Sprintf("%d-%d", f.Start, f.End)
	if f.Step > 1 {
		text += fmt.Sprintf(" step %d", f.Step)
	}
	return text
}

// sequenceText says how a sequence is doing.
func sequenceText(q *job.Sequence) string {
	text := fmt.Sprintf("%s, %d of %d done", q.State, q.States[job.Done], q.Request.Frames.Count())
	for _, state := range []job.State{job.Failed, job.Canceled, job.Deleted} {
		if n := q.States[state]; n > 0 {
			text += fmt.Sprintf(", %d %s", n, state)
		}
	}
	return text
}

func showSequence(ctx context.Context, env Env, arguments []string) error {
	r, c, ids, err := remoteCommand(env, "sequence", arguments, 1, 1, nil)
	if err != nil {
		return ignoreHelp(err)
	}
	q, err := c.Sequence(ctx, ids[0])
	if err != nil {
		return err
	}
	if r.json {
		return writeJSON(env.Stdout, q)
	}
	fmt.Fprintf(env.Stdout, "%s  %s\n%s\n", q.ID, q.Request.Job.Name, sequenceText(&q))
	return table(env.Stdout, "FRAME\tJOB\tSHUTTER\tSEED\tSTATE\tDONE\tROUNDS\tRELMSE\tERROR", func(w io.Writer) {
		for _, f := range q.Frames {
			s := job.Snapshot{State: f.State, Paused: f.Paused, Progress: f.Progress, RelMSE: f.RelMSE}
			fmt.Fprintf(w, "%d\t%s\t%.6g to %.6g s\t%d\t%s\t%d%%\t%d\t%s\t%s\n", f.Number, f.Job, f.ShutterOpen, f.ShutterClose,
				f.Seed, stateText(s), percent(s), f.RoundsDone, relMSEText(s), cmp.Or(f.Error, "-"))
		}
	})
}
