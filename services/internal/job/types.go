// Package job holds what a job is: the request a user makes, its states, and the views of it that
// the API, the command line and the dashboard show. It is pure: no clock, no goroutine, no I/O.
package job

import (
	"time"
)

// State of a job's life. It ends as Done, Failed or Canceled, unless it is refined.
type State string

// The states, in the order in which an undisturbed job passes them.
const (
	Queued        State = "queued"        // accepted; no worker has looked at it yet
	Inspecting    State = "inspecting"    // a worker loads the scene
	Bootstrapping State = "bootstrapping" // independent samples for b and the seeds (or for the film unit)
	Rendering     State = "rendering"     // rounds
	Done          State = "done"          // stop rule met; the image is final
	Failed        State = "failed"        // see Snapshot.Error
	Canceled      State = "canceled"      // by the user; the snapshot so far stays
)

// Integrator names, as in requests.
const (
	IntegratorAuto   = "auto"
	IntegratorPath   = "path"
	IntegratorBDPT   = "bdpt"
	IntegratorPSSMLT = "pssmlt"
	IntegratorMMLT   = "mmlt"
)

// Request is what a user asks for. A zero value of an optional field means "choose for me"; Options
// has what each does.
type Request struct {
	// Name for people; defaults to the scene file's name. It can be changed later.
	Name string `json:"name,omitempty"`
	// Priority among the jobs of all users, from -100 to 100: higher goes first. It can be changed later
	// and does not change the image.
	Priority int `json:"priority,omitempty"`
	// Scene is the digest of a stored bundle.
	Scene string `json:"scene"`
	// Entry is the scene file's path inside the bundle.
	Entry string `json:"entry"`
	// Defaults overrides the scene file's <default> values.
	Defaults map[string]string `json:"defaults,omitempty"`
	// Lenient turns what the importer does not know into warnings.
	Lenient bool `json:"lenient,omitempty"`
	// InspectOnly ends the job when a worker has looked at the scene: nothing is rendered.
	InspectOnly   bool   `json:"inspect_only,omitempty"`
	Integrator    string `json:"integrator,omitempty"`
	Under         string `json:"under,omitempty"`
	LightSampling string `json:"light_sampling,omitempty"`

	// Chains only. Kernel, with its size, is the law of small steps.
	Kernel               string  `json:"kernel,omitempty"`
	S1                   float64 `json:"s1,omitempty"`
	S2                   float64 `json:"s2,omitempty"`
	Sigma                float64 `json:"sigma,omitempty"`
	Scale                float64 `json:"scale,omitempty"`
	HalfWidth            float64 `json:"half_width,omitempty"`
	LargeStepProbability float64 `json:"large_step_probability,omitempty"`
	EyeStepProbability   float64 `json:"eye_step_probability,omitempty"`
	LightStepProbability float64 `json:"light_step_probability,omitempty"`
	// DelayedRejection, with the five that follow, is the second stage.
	DelayedRejection    string  `json:"delayed_rejection,omitempty"`
	SecondStage         string  `json:"second_stage,omitempty"`
	Concentration       float64 `json:"concentration,omitempty"`
	AcceptanceRule      string  `json:"acceptance_rule,omitempty"`
	AfterLargeSteps     bool    `json:"after_large_steps,omitempty"`
	LocalScale          float64 `json:"local_scale,omitempty"`
	LayerWeights        string  `json:"layer_weights,omitempty"`
	TechniqueCoordinate string  `json:"technique_coordinate,omitempty"`
	KernelTuning        string  `json:"kernel_tuning,omitempty"`
	Target              string  `json:"target,omitempty"`
	DirectApart         string  `json:"direct_apart,omitempty"`
	// Layers of the image file that tell how the chains explore.
	Layers []string `json:"layers,omitempty"`

	// BootstrapSamples is rounded up to what the group size asks for.
	BootstrapSamples uint64 `json:"bootstrap_samples,omitempty"`
	// Chains is rounded up likewise.
	Chains uint64 `json:"chains,omitempty"`
	// MaxDepth overrides the scene's; -1 has no limit.
	MaxDepth *int `json:"max_depth,omitempty"`
	// Width and Height override the scene's film size.
	Width  int `json:"width,omitempty"`
	Height int `json:"height,omitempty"`
	// Seed of the job.
	Seed uint64 `json:"seed,omitempty"`

	// ShutterOpen and ShutterClose override the scene's, in seconds of its keyframes' time.
	ShutterOpen  *float64 `json:"shutter_open,omitempty"`
	ShutterClose *float64 `json:"shutter_close,omitempty"`
	// ShutterCurve, with the ramps of a trapezoid as shares of the open time, is the efficiency.
	ShutterCurve     ShutterCurve `json:"shutter_curve,omitempty"`
	ShutterRampOpen  float64      `json:"shutter_ramp_open,omitempty"`
	ShutterRampClose float64      `json:"shutter_ramp_close,omitempty"`
	Exposure         string       `json:"exposure,omitempty"`
	// RollingShutter is how many seconds the last row of pixels lags behind the first.
	RollingShutter float64 `json:"rolling_shutter,omitempty"`

	// Stop rules; whichever is met first. With none, the scene's sample count decides.
	Stop StopRules `json:"stop"`
	// Resolved repeats an earlier job: its resolved spec in protobuf JSON. All choices above are
	// then ignored but Scene, Entry, Defaults, Lenient and Stop.
	Resolved string `json:"resolved,omitempty"`
}

// StopRules end a job on a complete round.
type StopRules struct {
	// SamplesPerPixel of plain path tracing.
	SamplesPerPixel uint64 `json:"samples_per_pixel,omitempty"`
	// MutationsPerPixel of chains: ends with the round that reaches this many on average.
	MutationsPerPixel uint64 `json:"mutations_per_pixel,omitempty"`
	// TargetError ends after two consecutive rounds whose relative MSE estimate is below it.
	TargetError float64 `json:"target_error,omitempty"`
	// TimeSeconds of rendering, then the round under way is the last.
	TimeSeconds float64 `json:"time_seconds,omitempty"`
	// Rounds ends after exactly this many rounds: repeats an image.
	Rounds int `json:"rounds,omitempty"`
}

// Interval is a confidence interval.
type Interval struct {
	Low  float64 `json:"low"`
	High float64 `json:"high"`
	// Level, for example 0.95.
	Level float64 `json:"level"`
}

// ConvergencePoint is what was known after a round.
type ConvergencePoint struct {
	Round           int      `json:"round"`
	Mutations       uint64   `json:"mutations"`
	PathEvaluations uint64   `json:"path_evaluations"`
	Rays            uint64   `json:"rays"`
	RelMSE          float64  `json:"rel_mse"`
	RelMSEInterval  Interval `json:"rel_mse_interval"`
	B               float64  `json:"b"`
	BStandardError  float64  `json:"b_standard_error"`
	CPUSeconds      float64  `json:"cpu_seconds"`
	WallSeconds     float64  `json:"wall_seconds"`
	FilmSHA256      string   `json:"film_sha256"`
	// Chains only.
	Acceptance             Acceptance `json:"acceptance"`
	CoordinatesPerMutation float64    `json:"coordinates_per_mutation,omitempty"`
	// EffectiveSamples is how many independent samples of the chains' target would tell the cells of
	// a 16 x 16 grid as exactly; 0 where it cannot be told.
	EffectiveSamples            float64 `json:"effective_samples,omitempty"`
	EffectiveSamplesPerMutation float64 `json:"effective_samples_per_mutation,omitempty"`
}

// Acceptance ratios of chain mutations; NaN-free: a kind that never ran is absent.
type Acceptance struct {
	Large *float64 `json:"large,omitempty"`
	Small *float64 `json:"small,omitempty"`
	// Subpath steps draw the eye or the light subpath anew and keep the other.
	Subpath *float64 `json:"subpath,omitempty"`
	// Second stages after rejected small steps, and after rejected large ones.
	Second           *float64 `json:"second,omitempty"`
	SecondAfterLarge *float64 `json:"second_after_large,omitempty"`
}

// Length is what is known about the samples of one length (chains).
type Length struct {
	// Edges of the paths (mmlt; 1 sees lights directly), or those that the eye path followed; 32 stands
	// for all longer ones, too.
	Edges int `json:"edges"`
	// B is their share of b, from the bootstrap (mmlt).
	B              *float64 `json:"b,omitempty"`
	BStandardError *float64 `json:"b_standard_error,omitempty"`
	// Probability of a large step to draw the length (mmlt).
	Probability *float64 `json:"probability,omitempty"`
	// Proposed is the share of first-stage proposals with it, Acceptance that of them accepted.
	Proposed   *float64 `json:"proposed,omitempty"`
	Acceptance *float64 `json:"acceptance,omitempty"`
}

// Technique is what is known about the samples of one bidirectional technique (mmlt).
type Technique struct {
	// LightVertices of the paths: 0 where the eye path meets the light by itself.
	LightVertices int `json:"light_vertices"`
	// Proposed is the share of first-stage proposals with it, Acceptance that of them accepted.
	Proposed   *float64 `json:"proposed,omitempty"`
	Acceptance *float64 `json:"acceptance,omitempty"`
}

// Snapshot is the public view of a job at one moment.
type Snapshot struct {
	ID string `json:"id"`
	// User who submitted it; empty where the server asks for no tokens.
	User string `json:"user,omitempty"`
	// Sequence that the job is a frame of.
	Sequence *FrameOf `json:"sequence,omitempty"`
	Request  Request  `json:"request"`
	State    State    `json:"state"`
	Paused   bool     `json:"paused"`
	// PauseReason says why the job paused itself and what to do; empty if the user paused it.
	PauseReason string `json:"pause_reason,omitempty"`
	// QueuePosition among the jobs of its coordinator that have work for more workers: the next free
	// one goes to 1. Absent if the job has none.
	QueuePosition int `json:"queue_position,omitempty"`
	// WaitingForMemory: the job is queued until there is room for its film beside those of others;
	// Activity has the sizes. Absent if it does not wait for that.
	WaitingForMemory bool       `json:"waiting_for_memory,omitempty"`
	Error            string     `json:"error,omitempty"`
	CreatedAt        time.Time  `json:"created_at"`
	StartedAt        *time.Time `json:"started_at,omitempty"`
	EndedAt          *time.Time `json:"ended_at,omitempty"`
	// StopReason says which rule ended the job, once it is done.
	StopReason string `json:"stop_reason,omitempty"`
	// Refinements counts how often the job went on with other stop rules, those of Request now.
	Refinements uint64 `json:"refinements,omitempty"`

	Integrator string `json:"integrator,omitempty"`
	Width      int    `json:"width,omitempty"`
	Height     int    `json:"height,omitempty"`
	Seed       uint64 `json:"seed"`

	// RoundsDone counts merged rounds; RoundSegments and RoundSegmentsDone tell of the one under
	// way (or of the phase before rendering).
	RoundsDone        int     `json:"rounds_done"`
	RoundSegments     int     `json:"round_segments"`
	RoundSegmentsDone int     `json:"round_segments_done"`
	Activity          string  `json:"activity,omitempty"`
	Progress          float64 `json:"progress"` // 0 to 1, towards the nearest stop rule; 1 only when done
	ETASeconds        float64 `json:"eta_seconds,omitempty"`

	MutationsPerSecond float64    `json:"mutations_per_second"`
	Mutations          uint64     `json:"mutations"`
	PathEvaluations    uint64     `json:"path_evaluations"`
	Rays               uint64     `json:"rays"`
	CPUSeconds         float64    `json:"cpu_seconds"`
	WallSeconds        float64    `json:"wall_seconds"`
	LoadSeconds        float64    `json:"load_seconds"`
	B                  float64    `json:"b"`
	BStandardError     float64    `json:"b_standard_error"`
	RelMSE             *float64   `json:"rel_mse,omitempty"`
	RelMSEInterval     *Interval  `json:"rel_mse_interval,omitempty"`
	Acceptance         Acceptance `json:"acceptance"`
	// CoordinatesPerMutation is how many random numbers a chain's proposals asked for.
	CoordinatesPerMutation float64 `json:"coordinates_per_mutation,omitempty"`
	// Lengths of samples (chains) and their techniques (mmlt).
	Lengths    []Length    `json:"lengths,omitempty"`
	Techniques []Technique `json:"techniques,omitempty"`
	// EffectiveSamples after the last round, see ConvergencePoint.
	EffectiveSamples            float64 `json:"effective_samples,omitempty"`
	EffectiveSamplesPerMutation float64 `json:"effective_samples_per_mutation,omitempty"`
	// LongestStay is the largest number of mutations that a chain has not moved for (chains).
	// TrappedChains are those that have not moved for 2000 and more by now.
	LongestStay   uint64            `json:"longest_stay,omitempty"`
	TrappedChains uint64            `json:"trapped_chains,omitempty"`
	Anomalies     map[string]uint64 `json:"anomalies"`
	FilmSHA256    string            `json:"film_sha256,omitempty"`
	Warnings      []string          `json:"warnings,omitempty"`
	// Stale: this is what was last stored; the coordinator that runs the job could not be asked.
	Stale bool `json:"stale,omitempty"`
	// Owner is the URL of the coordinator that runs the job, if it is another one.
	Owner string `json:"-"`
	// Resolved spec in protobuf JSON, once known: submit it as Request.Resolved to repeat the job.
	Resolved string `json:"resolved,omitempty"`
}

// Brief leaves out what only those need who look at one job.
func (s Snapshot) Brief() Snapshot {
	s.Request.Resolved, s.Resolved = "", ""
	s.Lengths, s.Techniques, s.Warnings = nil, nil, nil
	return s
}

// ForEvents leaves out what may be long and is the same in every event: the resolved spec and the
// request's values for the scene's defaults. Who needs them asks for the job or its plan.
func (s Snapshot) ForEvents() Snapshot {
	s.Request.Resolved, s.Request.Defaults, s.Resolved = "", nil, ""
	return s
}

// Image is a developed snapshot: linear RGB and the estimated variance of each pixel's mean.
type Image struct {
	Width, Height int
	// RGB and Variance hold 3 values per pixel, row by row from the top.
	RGB, Variance []float32
	// Layers beside them.
	Layers []ImageLayer
	// Attributes for the image file.
	SceneDigest, FilmSHA256, Integrator, JobID string
	Seed, Mutations                            uint64
	Rounds                                     int
	B, BStandardError, RelMSE                  float64
	Final                                      bool
}

// ImageLayer is a layer of the image file: Channels are its channels' names, after a dot.
type ImageLayer struct {
	Name     string
	Channels [3]string
	// Values, 3 per pixel, row by row from the top.
	Values []float32
}

// Event is one entry of a job's event log.
type Event struct {
	// Sequence grows by one per event of a job, from 1; it is the SSE id.
	Sequence uint64 `json:"sequence"`
	// Kind is state, progress, round, image, warning, fault, anomaly or log; deleted is the last of a
	// stream whose job was deleted.
	Kind string `json:"kind"`
	// At is when it happened.
	At time.Time `json:"at"`
	// Message for people.
	Message string `json:"message,omitempty"`
	// Coordinator that says so, and the epoch under which it owns the job.
	Coordinator string `json:"coordinator,omitempty"`
	Epoch       uint64 `json:"epoch,omitempty"`
	// Attributes by name: the worker, the round, and what else the message is about.
	Attributes map[string]any `json:"attributes,omitempty"`
	// Job is the snapshot after the event (state, progress and round events), without resolved and
	// without request.defaults and request.resolved.
	Job *Snapshot `json:"job,omitempty"`
	// Convergence is the point added by a round event.
	Convergence *ConvergencePoint `json:"convergence,omitempty"`
}

// Worker is the public view of a worker.
type Worker struct {
	ID                 string    `json:"id"`
	Name               string    `json:"name"`
	Version            string    `json:"version"`
	Threads            int       `json:"threads"`
	State              string    `json:"state"` // idle, busy, quarantined, draining or lost
	LastContact        time.Time `json:"last_contact"`
	LeasedSegments     int       `json:"leased_segments"`
	Activity           string    `json:"activity,omitempty"`
	MutationsPerSecond float64   `json:"mutations_per_second"`
	// Conflicts counts batches and reports that cannot be right, and batches that another worker
	// contradicts and no third has confirmed.
	Conflicts int `json:"conflicts"`
	// Exclusion says why the worker gets no more work: it was found to render wrong.
	Exclusion string `json:"exclusion,omitempty"`
}
