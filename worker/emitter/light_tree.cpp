#include "emitter/light_tree.h"

#include <limits>

#include "emitter/light_tree_row.h"

namespace metrofarm::emitter {
namespace {

using namespace light_tree_row;

// Of an importance that angles alone would bring to nothing: bounds are rounded, and a light that a
// bound has misjudged must not become a firefly.
constexpr float kLeastCosines = 1.F / 256;

// What is known of one child, by lane.
struct Child {
  Vec3 center;
  Float radius2;
  Vec3 axis;
  Float intensity;
  Float cos_normals, cos_spread;
};

struct RowValues {
  Float v[kStride];
};

// Eight numbers of each lane's row, from `first` on, by number.
void load_eight(const float* rows, const int32_t* start, int first, Float* out) {
  __m256 r[8];
  for (int lane = 0; lane < kLanes; ++lane) r[lane] = _mm256_loadu_ps(rows + start[lane] + first);
  // Lanes 0 and 1, 2 and 3 ... side by side; then lanes 0 to 3 and 4 to 7 of numbers k and k + 4.
  __m256 low[4], high[4], fours[8];
  for (size_t i = 0; i < 4; ++i) {
    low[i] = _mm256_unpacklo_ps(r[2 * i], r[2 * i + 1]);
    high[i] = _mm256_unpackhi_ps(r[2 * i], r[2 * i + 1]);
  }
  for (size_t half = 0; half < 2; ++half) {
    const size_t p = 2 * half, to = 4 * half;
    fours[to] = _mm256_shuffle_ps(low[p], low[p + 1], 0x44);
    fours[to + 1] = _mm256_shuffle_ps(low[p], low[p + 1], 0xee);
    fours[to + 2] = _mm256_shuffle_ps(high[p], high[p + 1], 0x44);
    fours[to + 3] = _mm256_shuffle_ps(high[p], high[p + 1], 0xee);
  }
  for (size_t k = 0; k < 4; ++k) {
    out[k] = _mm256_permute2f128_ps(fours[k], fours[4 + k], 0x20);
    out[k + 4] = _mm256_permute2f128_ps(fours[k], fours[4 + k], 0x31);
  }
}

// Lanes outside `lanes` read the root.
RowValues load_rows(const float* rows, Int row, Mask lanes) {
  alignas(32) int32_t start[kLanes];
  const Int masked = _mm256_and_si256(row, _mm256_castps_si256(lanes));
  (masked * Int(kStride)).store_aligned(start);
  RowValues values;
  for (int first = 0; first < kStride; first += kLanes)
    load_eight(rows, start, first, values.v + first);
  return values;
}

Child child_of(const RowValues& row, int side) {
  const Float* v = row.v + ptrdiff_t{side} * kChildStride;
  const Float* angles = row.v + kAngles + ptrdiff_t{side} * kAnglesStride;
  return {{v[kCenter], v[kCenter + 1], v[kCenter + 2]},
          v[kRadius2],
          {v[kAxis], v[kAxis + 1], v[kAxis + 2]},
          v[kIntensity],
          angles[0],
          angles[1]};
}

// cos(max(0, a - b)) of two angles in [0, pi]; of b also the sine.
Float cos_beyond(Float cos_a, Float cos_b, Float sin_b) {
  const Float sin_a = safe_sqrt(Float(1.F) - sqr(cos_a));
  return select(cos_a >= cos_b, Float(1.F), cos_a * cos_b + sin_a * sin_b);
}

// Conty Estevez and Kulla 2018, equation 3, with the distance to the center and no closer than the
// radius of the sphere around the lights.
Float importance(const Child& child, const Receiver& receiver, Mask sided) {
  const Vec3 to = child.center - receiver.position;
  const Float distance2 = xsimd::max(length_squared(to), Float(std::numeric_limits<float>::min()));
  const Float per_distance = Float(1.F) / xsimd::sqrt(distance2);
  const Mask inside = distance2 <= child.radius2;
  // Half the angle that the sphere fills.
  const Float sin2_fill = child.radius2 / distance2;
  const Float sin_fill = xsimd::sqrt(sin2_fill);
  const Float cos_fill = safe_sqrt(Float(1.F) - sin2_fill);

  const Float cos_out = -dot(child.axis, to) * per_distance;
  const Float sin_normals = safe_sqrt(Float(1.F) - sqr(child.cos_normals));
  const Float beyond = cos_beyond(cos_out, child.cos_normals, sin_normals);
  const Float emitted = select(inside, Float(1.F), cos_beyond(beyond, cos_fill, sin_fill));

  const Float cos_in = dot(receiver.normal, to) * per_distance;
  const Float in_front = select(inside, Float(1.F), cos_beyond(cos_in, cos_fill, sin_fill));
  const Float received = select(sided, xsimd::max(in_front, Float(0.F)), Float(1.F));

  const Float cosines = select(emitted >= child.cos_spread, emitted * received, Float(0.F));
  return child.intensity * xsimd::max(cosines, Float(kLeastCosines)) /
         xsimd::max(distance2, child.radius2);
}

}  // namespace

struct LightTree::Children {
  Float share_of_left;          // in [0, 1]; no number for a receiver that is none
  Int left, right;              // rows, or ~light
  Int left_count, right_count;  // leaves below
};

LightTree::Children LightTree::children(Int row, const Receiver& receiver, Mask lanes) const {
  const RowValues values = load_rows(rows_.data(), row, lanes);
  const Mask sided = length_squared(receiver.normal) > Float(0.F);
  const Float left = importance(child_of(values, 0), receiver, sided);
  const Float right = importance(child_of(values, 1), receiver, sided);
  return {left / (left + right), as_int(values.v[kReference]), as_int(values.v[kReference + 1]),
          as_int(values.v[kCount]), as_int(values.v[kCount + 1])};
}

// right(level, begin, middle): lanes that go to the right child, whose steps begin at `middle`.
template <class GoesRight>
LightTree::Choice LightTree::descend(int32_t all_steps, const Receiver& receiver, Mask lanes,
                                     GoesRight&& right) const {
  Int row(0), begin(0), steps(all_steps);
  Mask active = lanes;
  for (int level = 0; level < levels_ && any(active); ++level) {
    const Children c = children(row, receiver, active);
    // A share that is no number gives the left child the least.
    const Int wanted = truncate(to_float(steps) * c.share_of_left);
    const Int left_steps = xsimd::min(xsimd::max(wanted, c.left_count), steps - c.right_count);
    const Mask to_right = right(level, begin + left_steps);
    const Int next = select(to_right, c.right, c.left);
    begin = select(active & to_right, begin + left_steps, begin);
    steps = select(active, select(to_right, steps - left_steps, left_steps), steps);
    row = select(active, next, row);
    active = active & as_mask(_mm256_cmpgt_epi32(row, _mm256_set1_epi32(-1)));
  }
  return {~row, steps};
}

LightTree::Choice LightTree::choose(Int step, int32_t steps, const Receiver& receiver,
                                    Mask lanes) const {
  return descend(steps, receiver, lanes,
                 [&](int, Int middle) { return ~as_mask(_mm256_cmpgt_epi32(middle, step)); });
}

Int LightTree::steps_of(Int light, int32_t steps, const Receiver& receiver, Mask lanes) const {
  const Mask held = lanes & ~equal(gather(held_.data(), light, lanes), Int(0));
  const Int trail = gather(trail_.data(), light, held);
  const Choice choice = descend(steps, receiver, held, [&](int level, Int) {
    return ~equal(trail & Int(int32_t{1} << level), Int(0));
  });
  return Int(_mm256_and_si256(choice.steps, _mm256_castps_si256(held)));
}

uint64_t LightTree::bytes() const {
  return rows_.capacity() * sizeof(float) +
         (trail_.capacity() + held_.capacity()) * sizeof(int32_t);
}

}  // namespace metrofarm::emitter
