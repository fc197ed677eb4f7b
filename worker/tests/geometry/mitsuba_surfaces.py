#!/usr/bin/env python3
"""Prints mitsuba_surfaces.h: what Mitsuba 3 reports at hits of small scenes.

Usage: python mitsuba_surfaces.py > mitsuba_surfaces.h    (needs the PyPI package mitsuba 3.9.1)
"""

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
T = mi.ScalarTransform4f

POSITIONS = [-1, -0.8, 0.1, 1.2, -1, 0.3, -0.2, 1.1, -0.4]
NORMALS = [0, 0, 1, 0.6, 0, 0.8, 0, 0.6, 0.8]
TEXCOORDS = [0.1, 0.2, 0.3, 2, 1, -0.5]


def rotation(axis, degrees):
    return T().rotate((np.array(axis) / np.linalg.norm(axis)).tolist(), degrees)


def mesh(kind, flip):
    props = mi.Properties()
    props["flip_normals"] = flip
    has_uv = kind != "plain_mesh"
    made = mi.Mesh("mesh", 3, 1, has_vertex_normals=kind == "smooth_mesh",
                   has_vertex_texcoords=has_uv, props=props)
    values = mi.traverse(made)
    values["vertex_positions"] = POSITIONS
    values["faces"] = [0, 1, 2]
    if has_uv:
        values["vertex_texcoords"] = TEXCOORDS if kind == "smooth_mesh" else [0.5] * 6
    if kind == "smooth_mesh":
        values["vertex_normals"] = NORMALS
    values.update()
    return made


def shape_of(kind, flip, to_world):
    if kind.endswith("mesh"):
        return mesh(kind, flip)
    return {"type": kind, "flip_normals": flip, "to_world": to_world}


def scene_of(kind, flip, matrix, instanced):
    if not instanced:
        return mi.load_dict({"type": "scene", "shape": shape_of(kind, flip, matrix)})
    group = {"type": "shapegroup", "shape": shape_of(kind, flip, T())}
    return mi.load_dict({"type": "scene", "group": group,
                         "instance": {"type": "instance", "to_world": matrix,
                                      "group": {"type": "ref", "id": "group"}}})


def numbers(values):
    return "{" + ", ".join(f"{float(v):.7g}" for v in values) + "}"


def hits(kind, matrix, rng):
    """Rays towards points near the middle of the shape."""
    m = np.array(matrix.matrix)
    while True:
        inside = rng.uniform(-0.4, 0.4, 3) + ([0, 0, 0.5] if kind == "cylinder" else [0, 0, 0])
        target = m[:3, :3] @ inside + m[:3, 3]
        away = rng.normal(size=3)
        direction = -away / np.linalg.norm(away)
        yield np.float32(target - 9 * direction), np.float32(direction)


def row(kind, flip, matrix, instanced, rng):
    scene = scene_of(kind, flip, matrix, instanced)
    for origin, direction in hits(kind, matrix, rng):
        si = scene.ray_intersect(mi.Ray3f(origin.tolist(), direction.tolist()))
        # Grazing hits say little about anything but rounding.
        if si.is_valid() and abs(np.dot(si.n, direction)) > 0.2:
            break
    elements = np.array(matrix.matrix)[:3].reshape(-1)
    fields = [numbers(v) for v in (elements, origin, direction, si.p, si.n, si.sh_frame.n, si.uv,
                                   si.dp_du, si.dp_dv)]
    name = "k" + "".join(part.capitalize() for part in kind.split("_"))
    flags = f"{str(flip).lower()}, {str(instanced).lower()}"
    print(f"    {{Kind::{name}, {flags}, " + ", ".join(fields) + "},")


def main():
    rng = np.random.default_rng(7)
    turned = T().translate([3, -2, 1.5]) @ rotation([1, 2, -0.5], 70)
    even = turned @ T().scale(2.5)
    mirrored = turned @ T().scale([1.5, -2, 0.7]) @ rotation([0, 1, 1], 50)
    uneven = turned @ T().scale([0.4, 2, 1.3]) @ rotation([1, 0, 1], 35)
    own = {"sphere": [T(), even], "disk": [T(), turned @ T().scale([2, 3, 1]),
                                           turned @ T().scale([1, -2, 1])],
           "cylinder": [T(), turned @ T().scale([0.7, 0.7, 3])]}
    print("// Made by mitsuba_surfaces.py with Mitsuba " + mi.__version__ + "; do not edit.")
    print("// clang-format off\n#pragma once\n\nnamespace metrofarm::geometry {\n")
    print("enum class Kind { kSphere, kDisk, kCylinder, kSmoothMesh, kPlainMesh, kDegenerateMesh };")
    print("struct MitsubaHit {\n  Kind kind;\n  bool flip_normals, instanced;\n"
          "  double to_world[12];\n  double origin[3], direction[3];\n"
          "  double position[3], geometric_normal[3], shading_normal[3], uv[2], dp_du[3], "
          "dp_dv[3];\n};")
    print("inline constexpr MitsubaHit kMitsubaHits[] = {")
    for kind in ("sphere", "disk", "cylinder", "smooth_mesh", "plain_mesh", "degenerate_mesh"):
        for flip in (False, True):
            for matrix in own.get(kind, [T()]):
                row(kind, flip, matrix, False, rng)
                row(kind, flip, matrix, False, rng)
            for matrix in (even, mirrored, uneven):
                row(kind, flip, matrix, True, rng)
    print("};\n\n}  // namespace metrofarm::geometry")


if __name__ == "__main__":
    main()
