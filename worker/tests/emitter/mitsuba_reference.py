#!/usr/bin/env python3
"""Writes mitsuba_reference.h: what Mitsuba 3.9.1's emitter plugins answer.

Usage: mitsuba_reference.py > mitsuba_reference.h   (needs the PyPI packages mitsuba and numpy)
"""
import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
Transform = mi.ScalarTransform4f
rng = np.random.default_rng(20)

PLACE = Transform().look_at([1, 2, 3], [0, 0.5, -0.2], [0, 1, 0.3])
CHECKERS = {
    "type": "checkerboard",
    "color0": {"type": "rgb", "value": [0.9, 0.2, 0.1]},
    "color1": {"type": "rgb", "value": [0.1, 0.3, 0.7]},
    "to_uv": Transform().translate([0.13, 0.29, 0]).scale([3.7, 2.1, 1]),
}
RGB = {"type": "rgb", "value": [2, 3, 4]}
SPOT = {"type": "spot", "to_world": PLACE, "intensity": RGB, "cutoff_angle": 35.0,
        "beam_width": 10.0}
PROJECTOR = {"type": "projector", "to_world": PLACE, "fov": 50.0}
LIGHTS = {
    "kPoint": {"type": "point", "position": [1, 2, 3], "intensity": RGB},
    "kSpot": SPOT,
    "kTexturedSpot": {**SPOT, "texture": CHECKERS},
    "kProjector": {**PROJECTOR, "irradiance": RGB},
    "kTexturedProjector": {**PROJECTOR, "irradiance": CHECKERS},
    "kDirectional": {"type": "directional", "direction": [1, 2, -0.5], "irradiance": RGB},
}


def numbers(values):
    return "{" + ", ".join(f"{float(v):.9g}" for v in np.asarray(values).ravel()) + "}"


def points_before(place, count):
    """Points about the axis, a few of them behind."""
    local = np.stack([rng.uniform(-0.6, 0.6, count), rng.uniform(-0.6, 0.6, count),
                      np.ones(count)], axis=1) * rng.uniform(0.3, 4, (count, 1))
    local[-3:, 2] *= -1
    m = np.array(place.matrix, dtype=np.float64)
    return local @ m[:3, :3].T + m[:3, 3]


def light_rows(light):
    scene = mi.load_dict({"type": "scene", "light": light, "thing": {"type": "sphere"}})
    for p in points_before(PLACE, 40).astype(np.float32):
        it = dr.zeros(mi.SurfaceInteraction3f)
        it.p = mi.Point3f(*[float(c) for c in p])
        ds, value = scene.emitters()[0].sample_direction(it, mi.Point2f(0.5, 0.5))
        yield p, np.array(ds.d).ravel(), np.array(value).ravel()


def directions(count):
    some = rng.normal(size=(count, 3))
    seam = [[1e-4, 0, -1], [-1e-4, 0, -1], [1e-6, 0.3, -1], [-1e-6, 0.3, -1], [0.3, -0.8, -1]]
    poles = [[1e-3, 1, 0], [1e-3, 1, -2e-3], [1e-3, -1, 1e-3], [0, -1, -1e-3]]
    all_of_them = np.concatenate([some, seam, poles])
    return all_of_them / np.linalg.norm(all_of_them, axis=1, keepdims=True)


def environment_rows(image, place):
    scene = mi.load_dict({"type": "scene", "light": {
        "type": "envmap", "bitmap": mi.Bitmap(image), "scale": 1.5, "to_world": place}})
    turn = np.array(place.matrix, dtype=np.float64)[:3, :3]
    for d in directions(40) @ turn.T:
        d = (d / np.linalg.norm(d)).astype(np.float32)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(*[-float(c) for c in d])
        yield d, np.array(scene.emitters()[0].eval(si)).ravel()


def main():
    print("// What Mitsuba 3.9.1's emitter plugins answer; written by mitsuba_reference.py.")
    print("#pragma once\n\nnamespace metrofarm::emitter::mitsuba {\n")
    print("// clang-format off")
    print("struct LitPoint {\n  float point[3], direction[3], value[3];\n};")
    print(f"inline constexpr double kPlace[16] = {numbers(PLACE.matrix)};")
    for name, light in LIGHTS.items():
        print(f"inline constexpr LitPoint {name}[] = {{")
        for row in light_rows(light):
            print("    {" + ", ".join(numbers(part) for part in row) + "},")
        print("};")
    image = rng.random((4, 5, 3)).astype(np.float32)
    place = Transform().rotate([2 / 7, 3 / 7, 6 / 7], 70).scale([-1, 1, 1])
    print("inline constexpr int kMapWidth = 5, kMapHeight = 4;")
    print("inline constexpr float kMapScale = 1.5F;")
    print(f"inline constexpr float kMapPixels[] = {numbers(image)};")
    print(f"inline constexpr double kMapPlace[16] = {numbers(place.matrix)};")
    print("struct SeenDirection {\n  float direction[3], radiance[3];\n};")
    print("inline constexpr SeenDirection kMap[] = {")
    for row in environment_rows(image, place):
        print("    {" + ", ".join(numbers(part) for part in row) + "},")
    print("};\n// clang-format on\n\n}  // namespace metrofarm::emitter::mitsuba")


main()
