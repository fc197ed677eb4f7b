#!/usr/bin/env python3
"""Prints what Mitsuba's BSDFs answer, as the table mitsuba_values.inc of the tests.

    python mitsuba_values.py > mitsuba_values.inc      (mitsuba 3.9.1 from PyPI)

One line per material and pair of directions: the material's name in cases.cpp, wo, wi, the value
(with the cosine of wi) in R, G, B, and the density. Mitsuba calls our wo "wi" and our wi "wo".
"""

import math

import mitsuba as mi

mi.set_variant("scalar_rgb")


def rgb(r, g, b):
    return {"type": "rgb", "value": [r, g, b]}


METAL = {"eta": rgb(0.2, 0.9, 1.1), "k": rgb(3.9, 2.4, 2.1)}
GLASS = {"int_ior": 1.5, "ext_ior": 1.0}


def rough(kind, distribution, alpha, alpha_v=None, **more):
    sizes = {"alpha": alpha} if alpha_v is None else {"alpha_u": alpha, "alpha_v": alpha_v}
    return {"type": kind, "distribution": distribution, **sizes, **more}


def materials():
    """Name: (dictionary, narrowest roughness, index for directions below or None)."""
    found = {"diffuse": ({"type": "diffuse", "reflectance": rgb(0.2, 0.5, 0.8)}, 1, None)}
    for d in ("beckmann", "ggx"):
        for alpha in (0.01, 0.1, 0.5, 1.0):
            tag = f"{d}_{round(1000 * alpha)}"
            found[f"roughconductor_{tag}"] = (rough("roughconductor", d, alpha, **METAL), alpha, None)
            found[f"roughdielectric_{tag}"] = (rough("roughdielectric", d, alpha, **GLASS), alpha, 1.5)
        found[f"roughconductor_{d}_300_50"] = (
            rough("roughconductor", d, 0.3, 0.05, specular_reflectance=rgb(0.5, 0.7, 0.9), **METAL),
            0.05, None)
        found[f"roughdielectric_{d}_50_300"] = (
            rough("roughdielectric", d, 0.05, 0.3, specular_reflectance=rgb(0.5, 0.7, 0.9),
                  specular_transmittance=rgb(0.9, 0.6, 0.3), **GLASS), 0.05, 1.5)
        for alpha in (0.05, 0.3):
            for nonlinear in (False, True):
                name = f"roughplastic_{d}_{round(1000 * alpha)}" + ("_nonlinear" if nonlinear else "")
                found[name] = (
                    rough("roughplastic", d, alpha, int_ior=1.49, ext_ior=1.0, nonlinear=nonlinear,
                          diffuse_reflectance=rgb(0.2, 0.5, 0.8)), alpha, None)
    for nonlinear in (False, True):
        found["plastic" + ("_nonlinear" if nonlinear else "")] = (
            {"type": "plastic", "int_ior": 1.49, "ext_ior": 1.0, "nonlinear": nonlinear,
             "diffuse_reflectance": rgb(0.2, 0.5, 0.8),
             "specular_reflectance": rgb(0.9, 0.8, 0.7)}, 1, None)
    base = {"base_color": rgb(0.2, 0.5, 0.8)}
    found["principled"] = ({"type": "principled", **base}, 0.25, None)
    found["principled_metal"] = (
        {"type": "principled", **base, "metallic": 0.7, "roughness": 0.3, "anisotropic": 0.8,
         "spec_tint": 0.6, "eta": 1.7}, 0.05, None)
    found["principled_cloth"] = (
        {"type": "principled", **base, "sheen": 0.8, "sheen_tint": 0.5, "flatness": 0.6,
         "roughness": 0.7, "clearcoat": 0.9, "clearcoat_gloss": 0.3, "eta": 1.5}, 0.1, None)
    found["principled_glass"] = (
        {"type": "principled", **base, "spec_trans": 0.8, "roughness": 0.4, "eta": 1.5,
         "metallic": 0.1, "clearcoat": 0.5, "clearcoat_gloss": 0.5}, 0.16, 1.5)
    found["principledthin"] = ({"type": "principledthin", **base}, 0.25, 1.0)
    found["principledthin_sheet"] = (
        {"type": "principledthin", **base, "spec_trans": 0.6, "diff_trans": 0.7, "roughness": 0.5,
         "anisotropic": 0.5, "spec_tint": 0.4, "sheen": 0.5, "sheen_tint": 0.6, "flatness": 0.3,
         "eta": 1.33}, 0.2, 1.0)
    return found


def direction(cosine, turns):
    sine = math.sqrt(1 - cosine * cosine)
    return mi.Vector3f(sine * math.cos(2 * math.pi * turns), sine * math.sin(2 * math.pi * turns),
                       cosine)


def normalize(v):
    return v / math.sqrt(v.x * v.x + v.y * v.y + v.z * v.z)


def pairs(alpha, eta):
    """Directions around the lobes of this roughness, from above and, where asked, from below."""
    for cosine, turns in ((0.95, 0.1), (0.6, 0.35), (0.2, 0.8)):
        for side in (1, -1) if eta else (1,):
            wo = direction(side * cosine, turns)
            for slope in (0.0, 0.7, 2.0):
                m = normalize(mi.Vector3f(alpha * slope * 0.6, -alpha * slope * 0.8, 1))
                dot = wo.x * m.x + wo.y * m.y + wo.z * m.z
                yield wo, 2 * dot * m - wo
                if eta:
                    ratio = eta if side > 0 else 1 / eta
                    cos2 = 1 - (1 - dot * dot) / (ratio * ratio)
                    if cos2 > 0.01:
                        yield wo, m * (dot / ratio - side * math.sqrt(cos2)) - wo / ratio
            yield wo, direction(0.5, 0.55)
            if eta:
                yield wo, direction(-0.5, 0.55)


def number(x):
    return f"{x:.9g}"


def main():
    print(f"// Made by mitsuba_values.py with Mitsuba {mi.__version__}.")
    for name, (plugin, alpha, eta) in materials().items():
        bsdf = mi.load_dict(plugin)
        for wo, wi in pairs(alpha, eta):
            si = mi.SurfaceInteraction3f()
            si.wi = wo
            si.n = [0, 0, 1]
            si.sh_frame = mi.Frame3f([1, 0, 0], [0, 1, 0], [0, 0, 1])
            si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
            si.uv = [0.25, 0.25]
            value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, wi)
            numbers = [*wo, *wi, *value, pdf]
            print(f'{{"{name}", {{' + ", ".join(number(float(x)) for x in numbers) + "}},")


main()
