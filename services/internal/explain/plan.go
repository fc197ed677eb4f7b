package explain

import (
	"fmt"

	"google.golang.org/protobuf/encoding/protojson"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	scenev1 "metrofarm/services/gen/metrofarm/scene/v1"
	"metrofarm/services/internal/job"
	"metrofarm/services/internal/plan"
)

// Plan is what a job does and leaves out, and why.
type Plan struct {
	// Features of the renderer, used or skipped.
	Features []Feature `json:"features" doc:"What the renderer can do, and whether this job does it."`
	// Auto is what integrator auto measured and chose.
	Auto *Decision `json:"auto,omitempty" doc:"What integrator auto measured and chose; absent where the integrator was asked for."`
	// Tuning is how the pilot chose the size of small steps.
	Tuning *Tuning `json:"tuning,omitempty" doc:"How trials chose the size of small steps; absent where there were none."`
	// Choices that decide the image.
	Choices []Choice `json:"choices" doc:"Each value that decides the image, and why."`
}

// Tuning lists the trials of the size of small steps.
type Tuning struct {
	Reason      string    `json:"reason" doc:"The rule that decided."`
	Factors     []float64 `json:"factors" doc:"Of the kernel's lengths, by trial."`
	Acceptances []float64 `json:"acceptances" doc:"Share of small steps accepted, by trial."`
}

// Decision is how auto chose.
type Decision struct {
	Integrator       string  `json:"integrator" doc:"What it chose."`
	Reason           string  `json:"reason" doc:"The rule that decided."`
	PilotSamples     uint64  `json:"pilot_samples" doc:"Path-traced samples that it looked at."`
	RelativeVariance float64 `json:"relative_variance" doc:"Variance of a sample's luminance, relative to its surroundings in the image, over its squared mean."`
	ZeroShare        float64 `json:"zero_share" doc:"Share of samples that carried nothing."`
	TopShare         float64 `json:"top_share" doc:"Share of that light that the brightest thousandth of the samples carried."`
}

// Of explains a job. report is its scene report in protobuf JSON, "" before there is one.
func Of(snapshot job.Snapshot, report string) (Plan, error) {
	p := Plan{Features: []Feature{}}
	var err error
	if p.Choices, err = Choices(snapshot); err != nil || snapshot.Resolved == "" {
		return p, err
	}
	lenient := protojson.UnmarshalOptions{DiscardUnknown: true}
	spec := &jobv1.ResolvedSpec{}
	if err := lenient.Unmarshal([]byte(snapshot.Resolved), spec); err != nil {
		return p, fmt.Errorf("resolved spec of job %s: %w", snapshot.ID, err)
	}
	p.Auto, p.Tuning = decision(spec), tuning(spec)
	if report == "" {
		return p, nil
	}
	scene := &scenev1.SceneReport{}
	if err := lenient.Unmarshal([]byte(report), scene); err != nil {
		return p, fmt.Errorf("scene report of job %s: %w", snapshot.ID, err)
	}
	p.Features = Features(spec, scene)
	return p, nil
}

func tuning(spec *jobv1.ResolvedSpec) *Tuning {
	t := spec.GetKernelTuning()
	if t == nil {
		return nil
	}
	return &Tuning{Reason: t.GetReason(), Factors: t.GetFactors(), Acceptances: t.GetAcceptances()}
}

func decision(spec *jobv1.ResolvedSpec) *Decision {
	d := spec.GetAutoDecision()
	if d == nil {
		return nil
	}
	return &Decision{
		Integrator: plan.IntegratorName(spec), Reason: d.GetReason(), PilotSamples: d.GetPilotSamples(),
		RelativeVariance: d.GetRelativeVariance(), ZeroShare: d.GetZeroShare(), TopShare: d.GetTopShare(),
	}
}
