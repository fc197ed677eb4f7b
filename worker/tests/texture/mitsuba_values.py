"""Prints the tables of mitsuba_values.h: what Mitsuba's textures give for a few lookups.

usage: mitsuba_values.py > mitsuba_values.h        needs mitsuba 3.9.1
"""

import drjit as dr
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")

# Two rows of three pixels.
PIXELS = np.array(
    [
        [[0.1, 0.9, 0.4], [0.7, 0.2, 2.5], [0.0, 0.3, 0.8]],
        [[1.5, 0.6, 0.2], [0.4, 0.8, 0.1], [0.9, 0.0, 0.5]],
    ],
    dtype=np.float32,
)
COORDINATES = [
    (0.3, 0.3), (0.05, 0.95), (0.97, 0.02), (-0.1, 0.6), (-1.7, 1.3), (2.2, -0.4), (11.6, -7.9),
    (1.3, 0.8),
]  # fmt: skip
SCALED = [[2, 0, 0.25], [0, -3, 0.5], [0, 0, 1]]
TURNED = [[0.8, -0.6, 0.1], [0.6, 0.8, -0.2], [0, 0, 1]]
FILTERS = {"bilinear": "kBilinear", "nearest": "kNearest"}
WRAPS = {"repeat": "kRepeat", "mirror": "kMirror", "clamp": "kClamp"}
BYTES = [0, 1, 10, 11, 64, 127, 128, 200, 254, 255]
HEADER = """#pragma once

#include <array>
#include <limits>

#include "scene/description.h"

namespace metrofarm::texture::test {

using Filter = scene::TextureFilter;
using Wrap = scene::TextureWrap;

inline constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

// Rows from the top, as Mitsuba counts them: v = 0 is the image's upper edge.
inline constexpr int kWidth = 3, kHeight = 2;
inline constexpr std::array kPixels = {%s};

// to_uv, uv and gradient in Mitsuba's orientation, too.
struct BitmapValue {
  Filter filter;
  Wrap wrap;
  scene::UvMatrix to_uv;
  std::array<float, 2> uv;
  scene::Rgb colour;
  std::array<float, 2> gradient;
};
struct ByteValue {
  int byte;
  float linear;
};
struct CheckerboardValue {
  std::array<float, 2> uv;
  float value;
};
inline constexpr scene::UvMatrix kCheckerboardToUv = {%s};
""" % (
    ", ".join(f"{v:.1f}F" for v in PIXELS.ravel()),
    ", ".join(f"{v:.9g}" for row in SCALED[:2] for v in row),
)


def at(coordinates):
    """Surface interactions with these texture coordinates."""
    uv = np.array(coordinates, dtype=np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(uv))
    si.t = 1
    si.uv = mi.Point2f(uv[:, 0], uv[:, 1])
    return si


def numbers(values):
    return ", ".join(f"{float(v):.9g}" for v in values)


def matrix(rows):
    return mi.ScalarTransform3f(rows)


def bitmap_rows():
    identity = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    for to_uv in (identity, SCALED, TURNED):
        for filter_name, filter_value in FILTERS.items():
            for wrap_name, wrap_value in WRAPS.items():
                if filter_name == "nearest" and to_uv is not identity:
                    continue
                texture = mi.load_dict(
                    {
                        "type": "bitmap",
                        "data": mi.TensorXf(PIXELS),
                        "raw": True,
                        "filter_type": filter_name,
                        "wrap_mode": wrap_name,
                        "to_uv": matrix(to_uv),
                    }
                )
                si = at(COORDINATES)
                colour = np.array(texture.eval(si)).T
                # Mitsuba takes the derivative by the size after the matrix, not before: only
                # matrices without rotation show the derivative.
                gradient = np.broadcast_to(np.array(texture.eval_1_grad(si)).T, (len(colour), 2))
                for i, uv in enumerate(COORDINATES):
                    grad = "kUnknown, kUnknown" if to_uv is TURNED else numbers(gradient[i])
                    print(
                        f"    {{Filter::{filter_value}, Wrap::{wrap_value},"
                        f" {{{numbers(sum(to_uv[:2], []))}}}, {{{numbers(uv)}}},"
                        f" {{{numbers(colour[i])}}}, {{{grad}}}}},"
                    )


def byte_rows():
    pixels = np.array(BYTES, dtype=np.uint8).reshape(1, -1, 1).repeat(3, axis=2)
    texture = mi.load_dict(
        {
            "type": "bitmap",
            "bitmap": mi.Bitmap(pixels),
            "format": "variant",
            "filter_type": "nearest",
        }
    )
    si = at([((i + 0.5) / len(BYTES), 0.5) for i in range(len(BYTES))])
    colour = np.array(texture.eval(si))[0]
    for byte, value in zip(BYTES, colour):
        print(f"    {{{byte}, {float(value):.9g}}},")


def checkerboard_rows():
    texture = mi.load_dict({"type": "checkerboard", "to_uv": matrix(SCALED)})
    colour = np.array(texture.eval(at(COORDINATES)))[0]
    for uv, value in zip(COORDINATES, colour):
        print(f"    {{{{{numbers(uv)}}}, {float(value):.9g}}},")


def main():
    print("// Made by mitsuba_values.py with Mitsuba", mi.__version__)
    print(HEADER)
    print("// clang-format off\n")
    print("inline constexpr std::array kBitmapValues = std::to_array<BitmapValue>({")
    bitmap_rows()
    print("});\n\ninline constexpr std::array kByteValues = std::to_array<ByteValue>({")
    byte_rows()
    print("});\n\ninline constexpr std::array kCheckerboardValues = std::to_array<CheckerboardValue>({")
    checkerboard_rows()
    print("});\n// clang-format on\n\n}  // namespace metrofarm::texture::test")


main()
