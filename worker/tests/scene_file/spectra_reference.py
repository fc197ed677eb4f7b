#!/usr/bin/env python3
"""Prints what Mitsuba makes of the spectra in spectra_test.cpp (PyPI package mitsuba, 3.9.1)."""
import mitsuba as mi

SPECTRA = [
    "400:0.1, 500:0.2, 600:0.9, 700:0.3",
    "300:1, 900:1",
    "400:0, 500:0, 501:1, 540:1, 541:0, 700:0",
    "400:1.5, 500:3, 600:2",
    "380:0.04 460:0.07 461.5:0.5 600:0.4 780:0.45",
    "400:0, 500:8, 600:15.6, 700:18.4",
]


def read(kind: str, plugin: str, parameter: str, pairs: str) -> str:
    scene = mi.load_string(
        f'<{kind} version="3.0.0" type="{plugin}">'
        f'<spectrum name="{parameter}" value="{pairs}"/></{kind}>'
    )
    return ", ".join(f"{v:.6g}" for v in mi.traverse(scene)[parameter + ".value"])


def black_body(temperature: float) -> str:
    mi.set_variant("scalar_spectral")
    law = mi.load_dict({"type": "blackbody", "temperature": temperature})
    interaction = mi.SurfaceInteraction3f()
    pairs = []
    for wavelength in range(360, 831):
        interaction.wavelengths = [float(wavelength)] * 4
        pairs.append(f"{wavelength}:{law.eval(interaction)[0]:.9g}")
    mi.set_variant("scalar_rgb")
    return ", ".join(pairs)


mi.set_variant("scalar_rgb")
for spectrum in SPECTRA:
    print(spectrum)
    print("  reflectance", read("bsdf", "diffuse", "reflectance", spectrum))
    print("  index      ", read("bsdf", "conductor", "eta", spectrum))
    print("  emission   ", read("emitter", "point", "intensity", spectrum))
print("black body of 3000 K", read("emitter", "point", "intensity", black_body(3000)))
