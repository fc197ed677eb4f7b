"""The difftrans material of Mitsuba 0.6 as a plugin of Mitsuba 3, which has none.

Lambert's law on the other side: f = transmittance / pi where wi and wo are on different sides, else
0; alike from both. Import it after mitsuba.set_variant.
"""

import drjit
import mitsuba


class DiffuseTransmitter(mitsuba.BSDF):
    """One lobe, sampled by the cosine."""

    def __init__(self, properties: mitsuba.Properties) -> None:
        super().__init__(properties)
        self.transmittance = properties.get_texture("transmittance", 0.5)
        sides = mitsuba.BSDFFlags.FrontSide | mitsuba.BSDFFlags.BackSide
        flags = mitsuba.BSDFFlags.DiffuseTransmission | sides
        self.m_components = [flags]
        self.m_flags = flags

    def eval(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        return self.transmittance.eval(si, active) * self.pdf(ctx, si, wo, active)

    def pdf(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        through = active & (si.wi.z * wo.z < 0)
        return drjit.select(through, drjit.abs(wo.z) * drjit.inv_pi, 0)

    def eval_pdf(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx, si, sample1, sample2, active=True):  # noqa: ANN001, ANN201
        bs = drjit.zeros(mitsuba.BSDFSample3f)
        wo = mitsuba.warp.square_to_cosine_hemisphere(sample2)
        bs.wo = mitsuba.Vector3f(wo.x, wo.y, drjit.select(si.wi.z > 0, -wo.z, wo.z))
        bs.pdf = self.pdf(ctx, si, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_type = mitsuba.UInt32(+mitsuba.BSDFFlags.DiffuseTransmission)
        bs.sampled_component = mitsuba.UInt32(0)
        usable = active & (bs.pdf > 0)
        return bs, drjit.select(usable, self.transmittance.eval(si, usable), 0)

    def traverse(self, callback: mitsuba.TraversalCallback) -> None:
        callback.put("transmittance", self.transmittance, mitsuba.ParamFlags.Differentiable)

    def to_string(self) -> str:
        return "DiffuseTransmitter[]"


mitsuba.register_bsdf("difftrans", DiffuseTransmitter)
