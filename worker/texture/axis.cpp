#include "texture/axis.h"

namespace metrofarm::texture {
namespace {

// Position within the image, 0 .. 1.
struct Wrapped {
  Float position;
  Mask mirrored;
};

Float fraction(Float x) {
  return x - xsimd::floor(x);
}

Wrapped wrap_around(Float coordinate, Int wrap) {
  const Float turn = Float(2.F) * fraction(Float(0.5F) * coordinate);
  const Mask mirror = equal(wrap, scene::TextureWrap::kMirror);
  const Mask mirrored = mirror & (turn > Float(1.F));
  const Float there_and_back = select(mirrored, Float(2.F) - turn, turn);
  const Float clamped = xsimd::min(xsimd::max(coordinate, Float(0.F)), Float(1.F));
  const Mask repeat = equal(wrap, scene::TextureWrap::kRepeat);
  return {select(repeat, fraction(coordinate), select(mirror, there_and_back, clamped)), mirrored};
}

}  // namespace

Axis locate(Float coordinate, Int size, Int wrap, Mask bilinear) {
  const Wrapped in = wrap_around(coordinate, wrap);
  const Float x = in.position * to_float(size) - select(bilinear, Float(0.5F), Float(0.F));
  const Float floor = xsimd::floor(x);
  const Int last = size - Int(1);
  const Mask repeat = equal(wrap, scene::TextureWrap::kRepeat);
  const Int before_first = select(repeat, last, Int(0));
  const Int after_last = select(repeat, Int(0), last);
  // A position of exactly 1 lies in the last pixel, or is rounded from just below 0.
  const Int left = xsimd::min(truncate(floor), last);
  const Int right = left + Int(1);
  const Int first = select(less(left, Int(0)), before_first, left);
  const Int second = select(less(last, right), after_last, right);
  // The bound of 0 is for NaN, which truncates to the least integer.
  return {first, xsimd::max(second, Int(0)), x - floor, in.mirrored};
}

}  // namespace metrofarm::texture
