package job

import (
	"cmp"
	"slices"
)

// Radii of the kelemen kernels (Kelemen et al. 2002, section 3.2), as shares of the torus.
const (
	KelemenS1 = 1.9 / 1024
	KelemenS2 = 1.9 / 64
)

// Words of the options of chains.
const (
	On  = "on"
	Off = "off"

	KernelKelemen           = "kelemen"
	KernelKelemenCoordinate = "kelemen-coordinate"
	KernelGaussian          = "gaussian"
	KernelWrappedCauchy     = "wrapped-cauchy"
	KernelUniform           = "uniform"

	StageWrappedCauchy = "wrapped-cauchy"
	StageVonMises      = "von-mises"
	StageLocal         = "local"

	RuleOrbital     = "orbital"
	RuleTierneyMira = "tierney-mira"
	RuleGreenMira   = "green-mira"

	WeightsTwoLayer = "two-layer"
	WeightsKelemen  = "kelemen"

	TechniqueFrozen  = "frozen"
	TechniqueMutated = "mutated"

	TargetLuminance = "luminance"
	TargetEqualized = "equalized"

	LayerAcceptance = "acceptance"
	LayerTechniques = "techniques"
)

func chainOptions() []Option {
	return []Option{
		{
			"chains", "chains", "N", nil, chains, "at least so many chains",
			func(r *Request) any { return &r.Chains },
		},
		{
			"kernel", "kernel", "",
			[]string{KernelKelemen, KernelKelemenCoordinate, KernelGaussian, KernelWrappedCauchy, KernelUniform},
			chains, "law of small steps; default kelemen, in pairs", func(r *Request) any { return &r.Kernel },
		},
		{
			"s1", "s1", "S", nil, chains, "smallest radius or distance of the kelemen kernels; default 1.9/1024",
			func(r *Request) any { return &r.S1 },
		},
		{
			"s2", "s2", "S", nil, chains, "largest radius or distance of the kelemen kernels; default 1.9/64",
			func(r *Request) any { return &r.S2 },
		},
		{
			"sigma", "sigma", "S", nil, chains, "standard deviation of the gaussian kernel; default 0.01",
			func(r *Request) any { return &r.Sigma },
		},
		{
			"scale", "scale", "S", nil, chains, "scale of the wrapped-cauchy kernel; default 0.01",
			func(r *Request) any { return &r.Scale },
		},
		{
			"half_width", "half-width", "W", nil, chains, "half width of the uniform kernel; default 0.02",
			func(r *Request) any { return &r.HalfWidth },
		},
		{
			"large_step_probability", "large-step-probability", "P", nil, chains, "probability of a large step; default 0.3",
			func(r *Request) any { return &r.LargeStepProbability },
		},
		{
			"eye_step_probability", "eye-step-probability", "P", nil, chains,
			"probability of a step that draws the eye subpath anew and keeps the light subpath (under bdpt); default 0",
			func(r *Request) any { return &r.EyeStepProbability },
		},
		{
			"light_step_probability", "light-step-probability", "P", nil, chains,
			"probability of a step that draws the light subpath anew and keeps the eye subpath (under bdpt); default 0",
			func(r *Request) any { return &r.LightStepProbability },
		},
		{
			"delayed_rejection", "delayed-rejection", "",
			[]string{IntegratorAuto, On, Off},
			chains,
			"second stage after a rejected small step; default auto: off",
			func(r *Request) any { return &r.DelayedRejection },
		},
		{
			"second_stage", "second-stage", "",
			[]string{StageWrappedCauchy, StageVonMises, StageLocal},
			chains,
			"how it proposes: the state turned around the rejected one by an angle of this law, or a smaller step; default wrapped-cauchy", func(r *Request) any { return &r.SecondStage },
		},
		{
			"concentration", "concentration", "X", nil, chains,
			"of the angle's law: rho of wrapped-cauchy, default exp(-1/4); kappa of von-mises, default 2.63",
			func(r *Request) any { return &r.Concentration },
		},
		{
			"acceptance_rule", "acceptance-rule", "",
			[]string{RuleOrbital, RuleTierneyMira, RuleGreenMira},
			chains,
			"how the second stage is accepted; default orbital where it holds, else tierney-mira",
			func(r *Request) any { return &r.AcceptanceRule },
		},
		{
			"after_large_steps", "after-large-steps", "", nil, chains, "a second stage after rejected large steps too",
			func(r *Request) any { return &r.AfterLargeSteps },
		},
		{
			"local_scale", "local-scale", "X", nil, chains, "size of smaller steps relative to the kernel; default 0.25",
			func(r *Request) any { return &r.LocalScale },
		},
		{
			"layer_weights", "layer-weights", "",
			[]string{WeightsTwoLayer, WeightsKelemen},
			chains,
			"how large steps share in the image; default two-layer", func(r *Request) any { return &r.LayerWeights },
		},
		{
			"kernel_tuning", "kernel-tuning", "",
			[]string{On, Off},
			chains,
			"try sizes of small steps in a pilot and keep the one that is accepted well; default off", func(r *Request) any { return &r.KernelTuning },
		},
		{
			"target", "target", "",
			[]string{TargetLuminance, TargetEqualized},
			chains,
			"what chains seek: luminance, or luminance over a rough image of the scene, for equal relative error all over; default luminance",
			func(r *Request) any { return &r.Target },
		},
		{
			"direct_apart", "direct-apart", "",
			[]string{On, Off},
			chains,
			"leave light that bounces at most once to independent paths; default off", func(r *Request) any { return &r.DirectApart },
		},
		{
			"layers", "layers", "",
			[]string{LayerAcceptance, LayerTechniques},
			chains,
			"layers added to the EXR file, as a list with commas: how proposals fare by pixel; images by technique, mmlt only; default none",
			func(r *Request) any { return &r.Layers },
		},
		{
			"technique_coordinate", "technique-coordinate", "",
			[]string{TechniqueFrozen, TechniqueMutated},
			[]string{IntegratorMMLT},
			"what small steps do to the technique; default frozen",
			func(r *Request) any { return &r.TechniqueCoordinate },
		},
	}
}

// Isotropic tells whether the kernel of this name moves a pair of coordinates alike in all
// directions, which an orbital second stage needs. "" is the default.
func Isotropic(kernel string) bool {
	return kernel == "" || kernel == KernelKelemen || kernel == KernelGaussian
}

// checkChains checks what the options of chains have to do with each other.
func (r *Request) checkChains() error {
	kelemen := r.Kernel == "" || r.Kernel == KernelKelemen || r.Kernel == KernelKelemenCoordinate
	s1, s2 := cmp.Or(r.S1, KelemenS1), cmp.Or(r.S2, KelemenS2)
	switch {
	case r.S1 != 0 && !kelemen:
		return invalid("s1", "belongs to kernels kelemen and kelemen-coordinate")
	case r.S2 != 0 && !kelemen:
		return invalid("s2", "belongs to kernels kelemen and kelemen-coordinate")
	case !(s1 > 0 && s1 < s2 && s2 < 0.5):
		return invalid("s1", "and s2 are %v and %v, not 0 < s1 < s2 < 0.5", s1, s2)
	case r.Sigma != 0 && r.Kernel != KernelGaussian:
		return invalid("sigma", "belongs to kernel gaussian")
	case r.Sigma != 0 && !(r.Sigma > 0 && r.Sigma < 0.25):
		return invalid("sigma", "is %v, outside 0 < sigma < 0.25", r.Sigma)
	case r.Scale != 0 && r.Kernel != KernelWrappedCauchy:
		return invalid("scale", "belongs to kernel wrapped-cauchy")
	case r.Scale != 0 && !(r.Scale > 0 && r.Scale < 0.25):
		return invalid("scale", "is %v, outside 0 < scale < 0.25", r.Scale)
	case r.HalfWidth != 0 && r.Kernel != KernelUniform:
		return invalid("half_width", "belongs to kernel uniform")
	case r.HalfWidth != 0 && !(r.HalfWidth > 0 && r.HalfWidth < 0.5):
		return invalid("half_width", "is %v, outside 0 < half width < 0.5", r.HalfWidth)
	case r.LargeStepProbability != 0 && !(r.LargeStepProbability > 0 && r.LargeStepProbability <= 1):
		return invalid("large_step_probability", "is %v, outside 0 < p <= 1", r.LargeStepProbability)
	case r.Integrator == IntegratorPSSMLT && r.Under != IntegratorBDPT && (r.EyeStepProbability != 0 || r.LightStepProbability != 0):
		return invalid("eye_step_probability", "and light_step_probability belong to mmlt, and to pssmlt under bdpt: path tracing has no light subpath")
	case !(r.LargeStepProbability+r.EyeStepProbability+r.LightStepProbability <= 1):
		return invalid("eye_step_probability", "and light_step_probability and large_step_probability sum to more than 1")
	case !(r.EyeStepProbability >= 0 && r.EyeStepProbability <= 1):
		return invalid("eye_step_probability", "is %v, outside 0 <= p <= 1", r.EyeStepProbability)
	case !(r.LightStepProbability >= 0 && r.LightStepProbability <= 1):
		return invalid("light_step_probability", "is %v, outside 0 <= p <= 1", r.LightStepProbability)
	case slices.Contains(r.Layers, LayerTechniques) && r.Integrator != "" && r.Integrator != IntegratorAuto && r.Integrator != IntegratorMMLT:
		return invalid("layers", "techniques belong to mmlt; integrator is %s", r.Integrator)
	case r.Chains > maxChains:
		return invalid("chains", "is above %d", maxChains)
	}
	return r.checkSecondStage()
}

func (r *Request) checkSecondStage() error {
	on := r.DelayedRejection == On
	switch {
	case r.SecondStage != "" && !on:
		return invalid("second_stage", "belongs to delayed_rejection on")
	case r.AcceptanceRule != "" && !on:
		return invalid("acceptance_rule", "belongs to delayed_rejection on")
	case r.AfterLargeSteps && !on:
		return invalid("after_large_steps", "belongs to delayed_rejection on")
	case r.Concentration != 0 && (!on || r.SecondStage == StageLocal):
		return invalid("concentration", "belongs to delayed_rejection on with second_stage wrapped-cauchy or von-mises")
	case r.LocalScale != 0 && !(on && (r.SecondStage == StageLocal || r.AfterLargeSteps)):
		return invalid("local_scale", "belongs to delayed_rejection on with second_stage local or after_large_steps")
	case r.LocalScale != 0 && !(r.LocalScale > 0 && r.LocalScale <= 1):
		return invalid("local_scale", "is %v, outside 0 < scale <= 1", r.LocalScale)
	case r.SecondStage == StageVonMises && !(r.Concentration >= 0 && r.Concentration <= MaxKappa):
		return invalid("concentration", "is %v, outside 0 <= kappa <= %v", r.Concentration, MaxKappa)
	case r.SecondStage != StageVonMises && !(r.Concentration >= 0 && r.Concentration < 1):
		return invalid("concentration", "is %v, outside 0 <= rho < 1", r.Concentration)
	}
	return r.checkBalance()
}

// checkBalance refuses acceptance rules that would bias the image.
func (r *Request) checkBalance() error {
	local := r.SecondStage == StageLocal
	switch {
	case r.AcceptanceRule == RuleOrbital && local:
		return invalid("acceptance_rule", "orbital after second_stage local would bias the image, because the first stage's "+
			"density does not cancel: use tierney-mira or green-mira, or second_stage wrapped-cauchy or von-mises")
	case r.AcceptanceRule == RuleOrbital && !Isotropic(r.Kernel):
		return invalid("acceptance_rule", "orbital after kernel %s would bias the image, because that kernel is not "+
			"isotropic in a pair: use tierney-mira, or kernel kelemen or gaussian", r.Kernel)
	case r.AcceptanceRule == RuleGreenMira && !local:
		return invalid("acceptance_rule", "green-mira would bias the image where the second stage depends on the rejected "+
			"proposal: use orbital or tierney-mira, or second_stage local")
	}
	return nil
}

// MaxKappa is the largest concentration of a von Mises law.
const MaxKappa = 10000
