#!/usr/bin/env python3
"""Prints what Mitsuba's normalmap answers, as the table mitsuba_normals.inc of materials_test.cpp.

    python mitsuba_normals.py > mitsuba_normals.inc      (mitsuba 3.9.1 from PyPI)

One line per colour of the map and pair of directions: colour, wo, wi, value of the first channel.
"""

import math

import mitsuba as mi

mi.set_variant("scalar_rgb")


def unit(*v):
    return [x / math.sqrt(sum(y * y for y in v)) for x in v]


METAL = {"type": "roughconductor", "distribution": "ggx", "alpha_u": 0.3, "alpha_v": 0.1,
         "eta": {"type": "rgb", "value": 0.0}, "k": {"type": "rgb", "value": 1.0}}

print(f"// Made by mitsuba_normals.py with Mitsuba {mi.__version__}.")
for colour in ([0.5, 0.5, 1.0], [0.7, 0.4, 0.9], [0.3, 0.9, 0.7], [0.95, 0.5, 0.6]):
    bsdf = mi.load_dict({
        "type": "normalmap",
        "normalmap": {"type": "bitmap", "raw": True, "filter_type": "nearest", "bitmap":
                      mi.Bitmap(mi.TensorXf(colour * 4, (2, 2, 3)))},
        "nested": {"type": "twosided", "nested": METAL}})
    for wo in (unit(0.3, 0.2, 0.9), unit(-0.8, 0.1, 0.5), unit(0.2, -0.6, -0.5)):
        for wi in (unit(-0.3, 0.1, 0.8), unit(0.6, -0.4, 0.3), unit(0.1, 0.4, -0.8)):
            si = mi.SurfaceInteraction3f()
            si.wi = wo
            si.n = [0, 0, 1]
            si.sh_frame = mi.Frame3f([1, 0, 0], [0, 1, 0], [0, 0, 1])
            si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
            si.uv = [0.25, 0.25]
            value = bsdf.eval(mi.BSDFContext(), si, wi)
            numbers = [*colour, *wo, *wi, value[0]]
            print("{{" + ", ".join(f"{float(x):.9g}" for x in numbers) + "}},")
