package plan

import (
	"math"

	jobv1 "metrofarm/services/gen/metrofarm/job/v1"
	"metrofarm/services/internal/film"
	"metrofarm/services/internal/job"
)

const (
	defaultSigma     = 0.01
	defaultScale     = 0.01
	defaultHalfWidth = 0.02
	largeStep        = 0.3
	// Of local second stages, relative to the kernel.
	defaultLocalScale = 0.25
	// The von Mises law with the same mean resultant length as the default wrapped Cauchy.
	defaultKappa = 2.63
	packSize     = 8 // bootstrap samples that have one path length
)

// defaultRho of the wrapped Cauchy law of the second stage.
var defaultRho = math.Exp(-0.25)

// setChains makes the choices that only chains have.
func setChains(spec *jobv1.ResolvedSpec, r job.Request) {
	spec.Kernel = kernel(r)
	spec.DelayedRejection = delayedRejection(r)
	spec.LayerWeights = jobv1.LayerWeights_LAYER_WEIGHTS_TWO_LAYER
	if r.LayerWeights == job.WeightsKelemen {
		spec.LayerWeights = jobv1.LayerWeights_LAYER_WEIGHTS_KELEMEN
	}
	if Multiplexed(spec) {
		spec.TechniqueCoordinate = jobv1.TechniqueCoordinate_TECHNIQUE_COORDINATE_FROZEN
		if r.TechniqueCoordinate == job.TechniqueMutated {
			spec.TechniqueCoordinate = jobv1.TechniqueCoordinate_TECHNIQUE_COORDINATE_MUTATED
		}
		return
	}
	spec.Under = jobv1.Under_UNDER_PATH
	if r.Under == job.IntegratorBDPT {
		spec.Under = jobv1.Under_UNDER_BDPT
		return
	}
	spec.Kernel.EyeStepProbability, spec.Kernel.LightStepProbability = 0, 0 // there is no light subpath
}

// setSeeds chooses how many chains there are and how many samples they start from.
func setSeeds(spec *jobv1.ResolvedSpec, r job.Request) {
	pixels := uint64(spec.Width) * uint64(spec.Height)
	groups := uint64(roundUp((pixels+pixelsPerGroup-1)/pixelsPerGroup, groupMultiple))
	groups = min(max(groups, groupMultiple), maxGroups)
	if r.Chains > 0 {
		groups = roundUp((r.Chains+GroupSize-1)/GroupSize, groupMultiple)
	}
	spec.ChainGroups = uint32(groups)
	samples := min(max(bootstrapPerPix*pixels, minBootstrap), maxBootstrap)
	samples = max(samples, seedsPerChain*groups*GroupSize)
	if r.BootstrapSamples > 0 {
		samples = r.BootstrapSamples
	}
	spec.BootstrapSamples = roundUp(samples, bootstrapMultiple(spec))
}

// bootstrapMultiple divides every bootstrap: halves of whole groups, and with one path length per
// pack as many packs of each.
func bootstrapMultiple(spec *jobv1.ResolvedSpec) uint64 {
	multiple := film.Halves * uint64(spec.GetGroupSize())
	if !Multiplexed(spec) {
		return multiple
	}
	perLength := film.Halves * packSize * uint64(spec.GetMaxDepth())
	return multiple / greatestDivisor(multiple, perLength) * perLength
}

func greatestDivisor(a, b uint64) uint64 {
	for b != 0 {
		a, b = b, a%b
	}
	return a
}

func kernel(r job.Request) *jobv1.Kernel {
	k := &jobv1.Kernel{
		LargeStepProbability: or(r.LargeStepProbability, largeStep),
		EyeStepProbability:   r.EyeStepProbability,
		LightStepProbability: r.LightStepProbability,
	}
	switch r.Kernel {
	case job.KernelGaussian:
		k.Kind, k.Sigma = jobv1.KernelKind_KERNEL_KIND_GAUSSIAN, or(r.Sigma, defaultSigma)
	case job.KernelWrappedCauchy:
		k.Kind, k.Scale = jobv1.KernelKind_KERNEL_KIND_WRAPPED_CAUCHY, or(r.Scale, defaultScale)
	case job.KernelUniform:
		k.Kind, k.HalfWidth = jobv1.KernelKind_KERNEL_KIND_UNIFORM, or(r.HalfWidth, defaultHalfWidth)
	case job.KernelKelemenCoordinate:
		k.Kind = jobv1.KernelKind_KERNEL_KIND_KELEMEN_COORDINATE
		k.S1, k.S2 = or(r.S1, job.KelemenS1), or(r.S2, job.KelemenS2)
	default:
		k.Kind = jobv1.KernelKind_KERNEL_KIND_KELEMEN_PAIR
		k.S1, k.S2 = or(r.S1, job.KelemenS1), or(r.S2, job.KelemenS2)
	}
	return k
}

func delayedRejection(r job.Request) *jobv1.DelayedRejection {
	if r.DelayedRejection != job.On {
		return nil
	}
	d := &jobv1.DelayedRejection{
		Enabled: true, Move: jobv1.SecondMove_SECOND_MOVE_ORBITAL, AcceptanceRule: acceptanceRule(r),
		AfterLargeSteps: r.AfterLargeSteps, LocalScale: or(r.LocalScale, defaultLocalScale),
	}
	switch r.SecondStage {
	case job.StageLocal:
		d.Move = jobv1.SecondMove_SECOND_MOVE_LOCAL
	case job.StageVonMises:
		d.AngleLaw, d.Concentration = jobv1.AngleLaw_ANGLE_LAW_VON_MISES, or(r.Concentration, defaultKappa)
	default:
		d.AngleLaw, d.Concentration = jobv1.AngleLaw_ANGLE_LAW_WRAPPED_CAUCHY, or(r.Concentration, defaultRho)
	}
	return d
}

func acceptanceRule(r job.Request) jobv1.AcceptanceRule {
	switch {
	case r.AcceptanceRule == job.RuleGreenMira:
		return jobv1.AcceptanceRule_ACCEPTANCE_RULE_GREEN_MIRA
	case r.AcceptanceRule == job.RuleTierneyMira, r.SecondStage == job.StageLocal, !job.Isotropic(r.Kernel):
		return jobv1.AcceptanceRule_ACCEPTANCE_RULE_TIERNEY_MIRA
	}
	return jobv1.AcceptanceRule_ACCEPTANCE_RULE_ORBITAL
}

// or is the value asked for, or else the default.
func or(asked, otherwise float64) float64 {
	if asked != 0 {
		return asked
	}
	return otherwise
}
