#!/usr/bin/env python3
"""Prints mitsuba_cameras.h: rays of Mitsuba 3's sensors.

Usage: python mitsuba_cameras.py > mitsuba_cameras.h    (needs the PyPI package mitsuba 3.9.1)
"""

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
T = mi.ScalarTransform4f

WHOLE = {"type": "hdrfilm", "width": 300, "height": 200}
TALL = {"type": "hdrfilm", "width": 120, "height": 310}
CROPPED = WHOLE | {"crop_offset_x": 30, "crop_offset_y": 50, "crop_width": 120, "crop_height": 60}


def numbers(values):
    return "{" + ", ".join(f"{float(v):.8g}" for v in values) + "}"


def row(kind, film, to_world, rng, offset=(0, 0)):
    settings = {"type": kind, "film": film, "to_world": to_world, "near_clip": 0.25,
                "far_clip": 900.0}
    if kind != "orthographic":
        settings["fov"] = 55.0
    if kind == "perspective":
        settings["principal_point_offset_x"], settings["principal_point_offset_y"] = offset
    if kind == "thinlens":
        settings |= {"aperture_radius": 0.4, "focus_distance": 3.5}
    sensor = mi.load_dict(settings)
    at, lens = rng.uniform(-0.1, 1.1, 2), rng.uniform(0, 1, 2)
    ray, _ = sensor.sample_ray(0, 0.5, at.tolist(), lens.tolist())
    crop = [film.get(k, d) for k, d in (("crop_offset_x", 0), ("crop_offset_y", 0),
                                        ("crop_width", 0), ("crop_height", 0))]
    matrix = np.array(to_world.matrix)[:3].reshape(-1)
    name = {"perspective": "Perspective", "thinlens": "ThinLens",
            "orthographic": "Orthographic"}[kind]
    print(f"    {{scene::Projection::k{name}, {numbers([film['width'], film['height']])}, "
          f"{numbers(crop)}, {numbers(offset)}, {numbers(matrix)}, {numbers(at)}, "
          f"{numbers(lens)}, {numbers(ray.o)}, {numbers(ray.d)}, {float(ray.maxt):.8g}}},")


def main():
    rng = np.random.default_rng(5)
    look = T().look_at([1, 2, 3], [0, 0, 0.5], [0, 0, 1])
    print("// Made by mitsuba_cameras.py with Mitsuba " + mi.__version__ + "; do not edit.")
    print("// clang-format off\n#pragma once\n\n#include \"scene/description.h\"\n")
    print("namespace metrofarm::sensor {\n")
    print("// fov 55 degrees, near_clip 0.25, far_clip 900, aperture_radius 0.4, focus_distance 3.5;"
          "\n// position: fraction of the crop window.")
    print("struct MitsubaRay {\n  scene::Projection projection;\n  int film[2], crop[4];\n"
          "  double principal_point_offset[2];\n  double to_world[12];\n"
          "  float position[2], lens[2];\n  double origin[3], direction[3], t_max;\n};")
    print("inline constexpr MitsubaRay kMitsubaRays[] = {")
    for kind in ("perspective", "thinlens", "orthographic"):
        matrices = [T(), look, look @ T().scale([-1, 1, 1])]
        if kind == "orthographic":
            matrices += [look @ T().scale(2), look @ T().scale([2, 3, 5])]
        for film in (WHOLE, TALL, CROPPED):
            for matrix in matrices:
                for _ in range(3):
                    row(kind, film, matrix, rng)
                if kind == "perspective":
                    row(kind, film, matrix, rng, (0.1, -0.2))
    print("};\n\n}  // namespace metrofarm::sensor")


if __name__ == "__main__":
    main()
