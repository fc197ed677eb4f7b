"""The phong material of Mitsuba 0.6 as a plugin of Mitsuba 3, which has none.

Written from Lafortune and Willems, "Using the modified Phong reflectance model for physically
based rendering" (1994), equations 2 and 4: f = kd / pi + ks (n + 2) / (2 pi) cos^n(alpha), alpha
the angle to the mirror direction. Import it after mitsuba.set_variant.
"""

import drjit
import mitsuba

SPECULAR_SHARE = 0.5


class Phong(mitsuba.BSDF):
    """Both lobes in one component; a fixed share of the samples goes to each."""

    def __init__(self, properties: mitsuba.Properties) -> None:
        super().__init__(properties)
        self.diffuse = properties.get_texture("diffuse_reflectance", 0.5)
        self.specular = properties.get_texture("specular_reflectance", 0.2)
        self.exponent = properties.get("exponent", 30.0)
        # Of both reflectances: 0.6 makes them smaller where they exceed 1 together.
        self.scale = properties.get("scale", 1.0)
        flags = mitsuba.BSDFFlags.GlossyReflection | mitsuba.BSDFFlags.FrontSide
        self.m_components = [flags]
        self.m_flags = flags

    def _power(self, wi: mitsuba.Vector3f, wo: mitsuba.Vector3f) -> mitsuba.Float:
        cosine = drjit.dot(mitsuba.Vector3f(-wi.x, -wi.y, wi.z), wo)
        return drjit.select(cosine > 0, drjit.power(drjit.maximum(cosine, 1e-12), self.exponent), 0)

    def eval(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        lit = active & (si.wi.z > 0) & (wo.z > 0)
        peak = (self.exponent + 2) * drjit.inv_two_pi * self._power(si.wi, wo)
        value = self.diffuse.eval(si, lit) * drjit.inv_pi + self.specular.eval(si, lit) * peak
        return drjit.select(lit, value * (wo.z * self.scale), 0)

    def pdf(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        lit = active & (si.wi.z > 0) & (wo.z > 0)
        specular = (self.exponent + 1) * drjit.inv_two_pi * self._power(si.wi, wo)
        diffuse = mitsuba.warp.square_to_cosine_hemisphere_pdf(wo)
        return drjit.select(lit, drjit.lerp(diffuse, specular, SPECULAR_SHARE), 0)

    def eval_pdf(self, ctx, si, wo, active=True):  # noqa: ANN001, ANN201
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx, si, sample1, sample2, active=True):  # noqa: ANN001, ANN201
        cosine = drjit.power(1 - sample2.y, 1 / (self.exponent + 1))
        sine = drjit.safe_sqrt(1 - cosine * cosine)
        sin_phi, cos_phi = drjit.sincos(drjit.two_pi * sample2.x)
        mirror = mitsuba.Frame3f(mitsuba.Vector3f(-si.wi.x, -si.wi.y, si.wi.z))
        glossy = mirror.to_world(mitsuba.Vector3f(sine * cos_phi, sine * sin_phi, cosine))
        diffuse = mitsuba.warp.square_to_cosine_hemisphere(sample2)
        bs = drjit.zeros(mitsuba.BSDFSample3f)
        bs.wo = drjit.select(sample1 < SPECULAR_SHARE, glossy, diffuse)
        bs.pdf = self.pdf(ctx, si, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_type = mitsuba.UInt32(+mitsuba.BSDFFlags.GlossyReflection)
        bs.sampled_component = mitsuba.UInt32(0)
        usable = active & (bs.pdf > 0)
        return bs, drjit.select(usable, self.eval(ctx, si, bs.wo, usable) / bs.pdf, 0)

    def traverse(self, callback: mitsuba.TraversalCallback) -> None:
        callback.put("diffuse_reflectance", self.diffuse, mitsuba.ParamFlags.Differentiable)
        callback.put("specular_reflectance", self.specular, mitsuba.ParamFlags.Differentiable)

    def to_string(self) -> str:
        return f"Phong[exponent = {self.exponent}]"


mitsuba.register_bsdf("phong", Phong)
