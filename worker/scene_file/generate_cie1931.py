#!/usr/bin/env python3
"""Writes cie1931.cpp: the CIE 1931 colour matching functions and illuminant D65 every 5 nm.

Needs the PyPI package mitsuba (3.9.1 was used), whose tables are these values interpolated linearly.
"""
import pathlib

import mitsuba as mi

mi.set_variant("scalar_spectral")
FIRST, LAST, STEP = 360, 830, 5


def d65(wavelength: float) -> float:
    interaction = mi.SurfaceInteraction3f()
    interaction.wavelengths = [wavelength] * 4
    return illuminant.eval(interaction)[0]


illuminant = mi.load_dict({"type": "d65"})
rows = []
for wavelength in range(FIRST, LAST + 1, STEP):
    values = [float(v) for v in mi.cie1931_xyz(float(wavelength))] + [d65(float(wavelength))]
    rows.append("    {" + ", ".join(f"{v:.7g}" for v in values) + f"}},  // {wavelength}")
text = """// Written by generate_cie1931.py.
#include "scene_file/cie1931.h"

namespace metrofarm::scene_file {

// clang-format off
const CieRow kCieTable[kCieRows] = {
%s
};
// clang-format on

}  // namespace metrofarm::scene_file
""" % "\n".join(rows)
pathlib.Path(__file__).with_name("cie1931.cpp").write_text(text)
