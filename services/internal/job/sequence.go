package job

import (
	"encoding/json"
	"errors"
	"fmt"
	"strings"
	"time"
)

// Words of a sequence's seeds.
const (
	SeedsShared   = "shared"
	SeedsPerFrame = "per-frame"
)

// Defaults of Frames.
const (
	defaultFPS   = 24
	defaultAngle = 180
)

// Limits on sequences.
const (
	// MaxFrames of one sequence: it is created whole or not at all, in one step.
	MaxFrames = 1000
	// maxFrameBytes of the frames' requests together, as they are stored.
	maxFrameBytes = 32 << 20
	maxFrame      = 999_999
	maxFPS        = 1e6
	maxAngle      = 3600 // ten frames
	frameSuffix   = len(" frame 999999")
)

// Deleted is the state of a frame whose job was deleted. No job has it.
const Deleted State = "deleted"

// SequencePrefix begins the ids of sequences, and of nothing else.
const SequencePrefix = "seq-"

// Frames says which moments of the scene a sequence shows. Frame n is centred on the time n / fps
// seconds, in the time of the scene's keyframes: its shutter is open for angle / 360 / fps seconds,
// half before and half after that time.
type Frames struct {
	// Start and End are the first and the last frame.
	Start int `json:"start"`
	End   int `json:"end"`
	// Step from one frame to the next; 0: 1.
	Step int `json:"step,omitempty"`
	// FPS is frames per second; 0: 24.
	FPS float64 `json:"fps,omitempty"`
	// ShutterAngle in degrees: 360 leaves the shutter open from one frame to the next, 0 is an
	// instant. Absent: 180.
	ShutterAngle *float64 `json:"shutter_angle,omitempty"`
	// Seeds is "shared" (or empty): all frames have the job's seed, so that their noise does not flicker;
	// or "per-frame": frame n has the job's seed plus n.
	Seeds string `json:"seeds,omitempty"`
}

// SequenceRequest asks for a sequence: one job for each frame.
type SequenceRequest struct {
	// Job is what the frames have in common; the stop rules are those of each frame.
	Job Request `json:"job"`
	// Frames are those to render.
	Frames Frames `json:"frames"`
}

// FrameOption is a field of Frames.
type FrameOption = OptionOf[Frames]

// FrameOptions lists the fields of Frames but the range, which the command line takes as one.
func FrameOptions() []FrameOption {
	return []FrameOption{
		{
			"frames.step", "frame-step", "N", nil, nil, "render every Nth frame only; default 1",
			func(f *Frames) any { return &f.Step },
		},
		{
			"frames.fps", "fps", "F", nil, nil, "frames per second: frame n is centred on the time n / fps; default 24",
			func(f *Frames) any { return &f.FPS },
		},
		{
			"frames.shutter_angle", "shutter-angle", "DEGREES", nil, nil,
			"how long the shutter is open, 360 for the time from one frame to the next, 0 for an instant; default 180",
			func(f *Frames) any { return &f.ShutterAngle },
		},
		{
			"frames.seeds", "frame-seeds", "",
			[]string{SeedsShared, SeedsPerFrame},
			nil, "shared: all frames have the seed, noise does not flicker; per-frame: frame n has the seed plus n; default shared",
			func(f *Frames) any { return &f.Seeds },
		},
	}
}

// Validate checks everything that can be checked without the scene. Its errors are *FieldError.
func (s *SequenceRequest) Validate() error {
	if err := s.Frames.validate(); err != nil {
		return err
	}
	for _, c := range []struct {
		field, detail string
		wrong         bool
	}{
		{"inspect_only", "belongs to single jobs: a sequence renders", s.Job.InspectOnly},
		{"resolved", "belongs to single jobs: each frame has a spec of its own", s.Job.Resolved != ""},
		{"shutter_open", "belongs to single jobs: the frames say when the shutter is open", s.Job.ShutterOpen != nil},
		{"shutter_close", "belongs to single jobs: the frames say when the shutter is open", s.Job.ShutterClose != nil},
	} {
		if c.wrong {
			return inJob(invalid(c.field, "%s", c.detail))
		}
	}
	if err := s.Job.Validate(); err != nil {
		return inJob(err)
	}
	if err := s.checkShutters(); err != nil {
		return err
	}
	return s.checkBytes()
}

// checkShutters looks at the times of the first and the last frame; the others are between.
func (s *SequenceRequest) checkShutters() error {
	opens, closes := s.Frames.Shutter(s.Frames.Start)
	if _, last := s.Frames.Shutter(s.Frames.End); !(-opens <= maxSeconds && last <= maxSeconds) {
		return invalid("frames.fps", "makes shutters open between %v and %v, outside -%v..%v seconds", opens, last, maxSeconds, maxSeconds)
	}
	return inJob(s.Job.CheckOpen(opens, closes))
}

// checkBytes bounds what is stored in one step: each frame has a request of its own.
func (s *SequenceRequest) checkBytes() error {
	request, err := json.Marshal(s.Job)
	if err != nil {
		return fmt.Errorf("job: %w", err)
	}
	if all := len(request) * s.Frames.Count(); all > maxFrameBytes {
		return invalid("frames.end", "makes %d frames with requests of %d bytes each, %d together; one sequence has at most %d: "+
			"ask for fewer frames or give fewer defaults", s.Frames.Count(), len(request), all, maxFrameBytes)
	}
	return nil
}

func (f *Frames) validate() error {
	switch {
	case f.Start < 0 || f.Start > maxFrame:
		return invalid("frames.start", "is %d, outside 0..%d", f.Start, maxFrame)
	case f.End < f.Start || f.End > maxFrame:
		return invalid("frames.end", "is %d, outside %d (the start)..%d", f.End, f.Start, maxFrame)
	case f.Step < 0 || f.Step > maxFrame:
		return invalid("frames.step", "is %d, outside 1..%d", f.Step, maxFrame)
	case f.FPS != 0 && !(f.FPS > 0 && f.FPS <= maxFPS):
		return invalid("frames.fps", "is %v, outside 0 < frames per second <= %v", f.FPS, float64(maxFPS))
	case f.ShutterAngle != nil && !(*f.ShutterAngle >= 0 && *f.ShutterAngle <= maxAngle):
		return invalid("frames.shutter_angle", "is %v, outside 0..%d degrees", *f.ShutterAngle, maxAngle)
	case f.Seeds != "" && f.Seeds != SeedsShared && f.Seeds != SeedsPerFrame:
		return invalid("frames.seeds", "is %q; allowed: %q", f.Seeds, []string{SeedsShared, SeedsPerFrame})
	case f.Count() > MaxFrames:
		return invalid("frames.end", "makes %d frames; one sequence has at most %d", f.Count(), MaxFrames)
	}
	return nil
}

// inJob names the fields of errors as those of a sequence's job.
func inJob(err error) error {
	var field *FieldError
	if errors.As(err, &field) {
		return field.In("job")
	}
	return err
}

// Count is how many frames there are.
func (f *Frames) Count() int { return (f.End-f.Start)/max(1, f.Step) + 1 }

// Number of the i-th frame, from 0.
func (f *Frames) Number(i int) int { return f.Start + i*max(1, f.Step) }

// Shutter returns when the shutter opens and closes for a frame, in seconds.
func (f *Frames) Shutter(number int) (opens, closes float64) {
	fps, angle := f.FPS, float64(defaultAngle)
	if fps == 0 {
		fps = defaultFPS
	}
	if f.ShutterAngle != nil {
		angle = *f.ShutterAngle
	}
	half := angle / 720
	return (float64(number) - half) / fps, (float64(number) + half) / fps
}

// Seed of a frame, of a job with this seed.
func (f *Frames) Seed(seed uint64, number int) uint64 {
	if f.Seeds == SeedsPerFrame {
		return seed + uint64(number)
	}
	return seed
}

// Frame is the request of the i-th frame's job. Requires: a valid request with a name.
func (s *SequenceRequest) Frame(i int) Request {
	r, number := s.Job, s.Frames.Number(i)
	name := strings.ToValidUTF8(r.Name[:min(len(r.Name), maxNameBytes-frameSuffix)], "")
	r.Name = fmt.Sprintf("%s frame %d", name, number)
	r.Seed = s.Frames.Seed(r.Seed, number)
	opens, closes := s.Frames.Shutter(number)
	r.ShutterOpen, r.ShutterClose = &opens, &closes
	return r
}

// FrameOf says that a job is a frame of a sequence.
type FrameOf struct {
	// ID of the sequence.
	ID string `json:"id"`
	// Frame is its number.
	Frame int `json:"frame"`
}

// Frame is the public view of one frame of a sequence.
type Frame struct {
	Number int `json:"number"`
	// Job that renders it.
	Job string `json:"job"`
	// Seed of the job; the shutter is open from ShutterOpen to ShutterClose, in seconds.
	Seed         uint64  `json:"seed"`
	ShutterOpen  float64 `json:"shutter_open"`
	ShutterClose float64 `json:"shutter_close"`
	// State of the job; "deleted" if it was deleted.
	State    State   `json:"state"`
	Paused   bool    `json:"paused"`
	Progress float64 `json:"progress"` // 0 to 1, as in Snapshot
	// Error that ended the job.
	Error      string   `json:"error,omitempty"`
	RoundsDone int      `json:"rounds_done"`
	RelMSE     *float64 `json:"rel_mse,omitempty"`
	FilmSHA256 string   `json:"film_sha256,omitempty"`
	// Stale as in Snapshot.
	Stale bool `json:"stale,omitempty"`
	// Links are paths of the interface by what they lead to: job, exr and png.
	Links map[string]string `json:"links,omitempty"`
	// Owner as in Snapshot.
	Owner string `json:"-"`
}

// Take what a snapshot says about the frame.
func (f *Frame) Take(s Snapshot) {
	f.State, f.Paused, f.Progress, f.Error = s.State, s.Paused, s.Progress, s.Error
	f.RoundsDone, f.RelMSE, f.FilmSHA256 = s.RoundsDone, s.RelMSE, s.FilmSHA256
	f.Stale, f.Owner = s.Stale, s.Owner
}

// Sequence is the public view of a sequence.
type Sequence struct {
	ID string `json:"id"`
	// User who submitted it; empty where the server asks for no tokens.
	User    string          `json:"user,omitempty"`
	Request SequenceRequest `json:"request"`
	// State of the whole: queued until a frame has begun, rendering until all have ended; then failed if
	// one has failed, else canceled if one was canceled, else done.
	State State `json:"state"`
	// States counts the frames by state.
	States    map[State]int `json:"states"`
	CreatedAt time.Time     `json:"created_at"`
	// Frames in order; left out in lists.
	Frames []Frame `json:"frames,omitempty"`
}

// NewSequence makes the view of a sequence whose frames are in these states.
func NewSequence(id, user string, request SequenceRequest, created time.Time, states []State) Sequence {
	s := Sequence{ID: id, User: user, Request: request, CreatedAt: created}
	s.count(states)
	return s
}

// SetFrames makes them the sequence's.
func (s *Sequence) SetFrames(frames []Frame) {
	s.Frames = frames
	states := make([]State, len(frames))
	for i, f := range frames {
		states[i] = f.State
	}
	s.count(states)
}

func (s *Sequence) count(states []State) {
	s.States = make(map[State]int)
	begun, going := false, false
	for _, state := range states {
		s.States[state]++
		begun = begun || state != Queued
		going = going || !state.Ended() && state != Deleted
	}
	switch {
	case !begun:
		s.State = Queued
	case going:
		s.State = Rendering
	case s.States[Failed] > 0:
		s.State = Failed
	case s.States[Canceled] > 0:
		s.State = Canceled
	default:
		s.State = Done
	}
}

// NewFrame is the i-th frame of a request, rendered by a job of which nothing is known.
func (s *SequenceRequest) NewFrame(i int, id string) Frame {
	number := s.Frames.Number(i)
	opens, closes := s.Frames.Shutter(number)
	return Frame{
		Number: number, Job: id, Seed: s.Frames.Seed(s.Job.Seed, number), ShutterOpen: opens, ShutterClose: closes, State: Deleted,
	}
}
