// Building a LightTree: top down, by the surface area orientation heuristic (Conty Estevez and
// Kulla 2018, section 4.1) over twelve bins per axis.
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "base/check.h"
#include "emitter/light_tree.h"
#include "emitter/light_tree_row.h"

namespace metrofarm::emitter {
namespace {

using namespace light_tree_row;
using Leaf = LightTree::Leaf;

constexpr int kMostLevels = 31;  // as many bits as a trail has
constexpr int kBins = 12;

// Cosines and radii are rounded to float and the arithmetic of lanes rounds again: bounds are kept
// wider than that.
constexpr double kSlack = 1e-5;

double center(const Leaf& leaf, int axis) {
  return 0.5 * (leaf.bounds.lower[axis] + leaf.bounds.upper[axis]);
}

double diagonal2(const LightBounds& b) {
  double sum = 0;
  for (int k = 0; k < 3; ++k) sum += (b.upper[k] - b.lower[k]) * (b.upper[k] - b.lower[k]);
  return sum;
}

// What a child costs. The diagonal stands for the surface, which vanishes for lights in a row.
double cost_of(const LightBounds& b) {
  return b.intensity * lit_solid_angle(b) * diagonal2(b);
}

// Where centers lie along an axis.
struct Interval {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  int bin(double at) const {
    return std::clamp(static_cast<int>(kBins * ((at - low) / (high - low))), 0, kBins - 1);
  }
};

struct Split {
  int axis = -1;  // none
  int first_right_bin = 0;
  double cost = std::numeric_limits<double>::infinity();
  Interval along;
};

struct Bin {
  LightBounds bounds;
  bool used = false;

  void add(const LightBounds& more) {
    bounds = used ? bounds_of(bounds, more) : more;
    used = true;
  }
};

// The best border between two bins of an axis.
void try_axis(const Leaf* leaves, size_t count, int axis, double regularity, Split& best) {
  Interval along;
  for (size_t i = 0; i < count; ++i) {
    along.low = std::min(along.low, center(leaves[i], axis));
    along.high = std::max(along.high, center(leaves[i], axis));
  }
  if (!(along.high > along.low)) return;
  Bin bins[kBins];
  for (size_t i = 0; i < count; ++i) bins[along.bin(center(leaves[i], axis))].add(leaves[i].bounds);
  double from_right[kBins] = {};
  Bin sum;
  for (int k = kBins - 1; k > 0; --k) {
    if (bins[k].used) sum.add(bins[k].bounds);
    from_right[k] = sum.used ? cost_of(sum.bounds) : 0;
  }
  sum = Bin{};
  for (int k = 1; k < kBins; ++k) {
    if (bins[k - 1].used) sum.add(bins[k - 1].bounds);
    const double cost = regularity * (cost_of(sum.bounds) + from_right[k]);
    if (cost < best.cost) best = {axis, k, cost, along};
  }
}

// Orders the leaves so that those of the left child come first; returns their number.
size_t partition(Leaf* leaves, size_t count, const LightBounds& bounds, int level) {
  double extent[3];
  for (int k = 0; k < 3; ++k) extent[k] = bounds.upper[k] - bounds.lower[k];
  const int longest = static_cast<int>(std::max_element(extent, extent + 3) - extent);
  Split best;
  const bool room = level + static_cast<int>(std::bit_width(count)) < kMostLevels;
  for (int axis = 0; axis < 3 && room; ++axis) {
    if (extent[axis] > 0) try_axis(leaves, count, axis, extent[longest] / extent[axis], best);
  }
  if (best.axis >= 0) {
    Leaf* middle = std::stable_partition(leaves, leaves + count, [&](const Leaf& leaf) {
      return best.along.bin(center(leaf, best.axis)) < best.first_right_bin;
    });
    const auto left = static_cast<size_t>(middle - leaves);
    if (left > 0 && left < count) return left;
  }
  std::stable_sort(leaves, leaves + count, [&](const Leaf& a, const Leaf& b) {
    return center(a, longest) < center(b, longest);
  });
  return count / 2;
}

}  // namespace

LightTree::LightTree(std::vector<Leaf> leaves, size_t light_count)
    : trail_(light_count, 0),
      held_(light_count, 0),
      leaf_count_(static_cast<int32_t>(leaves.size())) {
  METROFARM_CHECK(leaves.size() > 1 && leaves.size() < size_t{1} << 24);
  double strongest = 0;
  for (const Leaf& leaf : leaves) strongest = std::max(strongest, leaf.bounds.intensity);
  for (Leaf& leaf : leaves) {
    METROFARM_CHECK(usable(leaf.bounds));
    leaf.bounds.intensity /= strongest;
  }
  rows_.reserve(kStride * (leaves.size() - 1));
  LightBounds all;
  build(leaves, 0, leaves.size(), 0, 0, all);
}

// Builds the node of leaves [first, end) and returns how its parent refers to it.
int32_t LightTree::build(std::vector<Leaf>& leaves, size_t first, size_t end, int level,
                         uint32_t trail, LightBounds& bounds) {
  if (end - first == 1) {
    const Leaf& leaf = leaves[first];
    bounds = leaf.bounds;
    trail_[leaf.light] = static_cast<int32_t>(trail);
    held_[leaf.light] = -1;
    return ~leaf.light;
  }
  METROFARM_CHECK(level < kMostLevels);
  levels_ = std::max(levels_, level + 1);
  bounds = leaves[first].bounds;
  for (size_t i = first + 1; i < end; ++i) bounds = bounds_of(bounds, leaves[i].bounds);
  const size_t middle = first + partition(&leaves[first], end - first, bounds, level);
  const auto row = static_cast<int32_t>(rows_.size() / kStride);
  rows_.resize(rows_.size() + kStride);
  LightBounds left, right;
  const int32_t to_left = build(leaves, first, middle, level + 1, trail, left);
  const int32_t to_right =
      build(leaves, middle, end, level + 1, trail | uint32_t{1} << level, right);
  store_child(row, 0, left, to_left, middle - first);
  store_child(row, 1, right, to_right, end - middle);
  return row;
}

void LightTree::store_child(int32_t row, int side, const LightBounds& bounds, int32_t reference,
                            size_t count) {
  float* whole = &rows_[size_t(row) * kStride];
  float* child = whole + ptrdiff_t{side} * kChildStride;
  double far = 0;
  for (int k = 0; k < 3; ++k) {
    child[kCenter + k] = static_cast<float>(0.5 * (bounds.lower[k] + bounds.upper[k]));
    child[kAxis + k] = static_cast<float>(bounds.normals.axis[k]);
    far = std::max({far, std::fabs(bounds.lower[k]), std::fabs(bounds.upper[k])});
  }
  const double radius = 0.5 * std::sqrt(diagonal2(bounds)) + kSlack * far;
  child[kRadius2] = static_cast<float>(radius * radius);
  // Far below the strongest a light is as good as the weakest that a float still tells from none.
  child[kIntensity] = std::max(static_cast<float>(bounds.intensity), 1e-30F);
  float* angles = whole + kAngles + ptrdiff_t{side} * kAnglesStride;
  angles[0] = static_cast<float>(std::max(bounds.normals.cosine - kSlack, -1.0));
  angles[1] = static_cast<float>(std::max(bounds.cos_spread - kSlack, -1.0));
  whole[kReference + side] = std::bit_cast<float>(reference);
  whole[kCount + side] = std::bit_cast<float>(static_cast<int32_t>(count));
}

}  // namespace metrofarm::emitter
