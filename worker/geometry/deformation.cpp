#include "geometry/deformation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>

namespace metrofarm::geometry {
namespace {

// Where a time lies between keys.
struct KeyPlace {
  size_t key = 0, next = 0;
  double share = 0;  // of the way to the next
};

KeyPlace place_of(const std::vector<double>& times, double time) {
  const auto after = std::upper_bound(times.begin(), times.end(), time);
  if (after == times.begin()) return {};
  const auto next = static_cast<size_t>(after - times.begin());
  if (after == times.end()) return {next - 1, next - 1, 0};
  return {next - 1, next, (time - times[next - 1]) / (times[next] - times[next - 1])};
}

double value_at(const DeformingMesh& mesh, const KeyPlace& place, size_t i) {
  return (1 - place.share) * mesh.keys[place.key].positions[i] +
         place.share * mesh.keys[place.next].positions[i];
}

// The largest that it has at any key.
double size_of(const DeformingMesh& mesh) {
  double size = 0;
  for (const scene::VertexKey& key : mesh.keys) {
    for (size_t axis = 0; axis < 3; ++axis) {
      double low = std::numeric_limits<double>::infinity(), high = -low;
      for (size_t i = axis; i < key.positions.size(); i += 3) {
        low = std::min(low, double(key.positions[i]));
        high = std::max(high, double(key.positions[i]));
      }
      size = std::max(size, high - low);
    }
  }
  return size;
}

// The way of a vertex is bent at keys only: there steps in between deviate most. Gives up from
// `most` on.
double deviation(const DeformingMesh& mesh, const std::vector<double>& times,
                 const motion::Interval& interval, int segments, double most) {
  double worst = 0;
  for (size_t k = 0; k < times.size() && worst < most; ++k) {
    if (!(times[k] > interval.begin && times[k] < interval.end)) continue;
    const double at = (times[k] - interval.begin) / interval.length() * segments;
    const double step = std::floor(at), share = at - step;
    const auto time = [&](double s) { return interval.begin + interval.length() * s / segments; };
    const KeyPlace before = place_of(times, time(step)), after = place_of(times, time(step + 1));
    for (size_t i = 0; i < mesh.keys[k].positions.size(); ++i) {
      const double between =
          (1 - share) * value_at(mesh, before, i) + share * value_at(mesh, after, i);
      worst = std::max(worst, std::fabs(between - mesh.keys[k].positions[i]));
    }
  }
  return worst;
}

// The fewest steps that meet the keys, or those among them that come nearest: steps take memory.
int segments_of(const DeformingMesh& mesh, const std::vector<double>& times,
                const motion::Interval& interval) {
  constexpr int kMost = 64;
  constexpr double kTolerance = 1e-4;
  const double enough = kTolerance * size_of(mesh);
  int best = 1;
  double least = std::numeric_limits<double>::infinity();
  for (int segments = 1; segments <= kMost && least > enough; ++segments) {
    const double found = deviation(mesh, times, interval, segments, least);
    if (found >= least) continue;
    least = found;
    best = segments;
  }
  return best;
}

void append_step(const std::vector<float>& a, const std::vector<float>& b, double share,
                 std::vector<float>& table) {
  for (size_t i = 0; i < a.size(); ++i)
    table.push_back(static_cast<float>((1 - share) * a[i] + share * b[i]));
}

bool moves_during(const std::vector<double>& times, const motion::Interval& interval) {
  return interval.length() > 0 && times.front() < interval.end && times.back() > interval.begin;
}

bool has_normals(const DeformingMesh& mesh) {
  return !mesh.keys[0].normals.empty();
}

}  // namespace

Deformations::Deformations(const std::vector<scene::Shape>& shapes, const Primitives& primitives,
                           const motion::Interval& interval, uint64_t max_bytes) {
  const std::vector<DeformingMesh>& meshes = primitives.deforming;
  if (meshes.empty()) return;
  const auto times = [&](size_t mesh) -> const std::vector<double>& {
    return shapes[meshes[mesh].shape].key_times;
  };
  std::vector<int> segments;
  for (size_t i = 0; i < meshes.size(); ++i) {
    const bool moves = moves_during(times(i), interval);
    segments.push_back(moves ? segments_of(meshes[i], times(i), interval) : 0);
    anything_moves_ = anything_moves_ || moves;
  }
  reserve(meshes, segments, max_bytes);
  for (std::vector<int32_t>* table : {&segments_, &rows_, &first_vertex_})
    table->assign(shapes.size(), 0);
  first_row_.assign(shapes.size(), -1);
  for (size_t i = 0; i < meshes.size(); ++i) add(meshes[i], times(i), interval, segments[i]);
  positions_.resize(positions_.size() + kSpareFloats, 0.F);
  if (!normals_.empty()) normals_.resize(normals_.size() + kSpareFloats, 0.F);
}

void Deformations::reserve(const std::vector<DeformingMesh>& meshes,
                           const std::vector<int>& segments, uint64_t max_bytes) {
  // Lanes number floats, not rows, when they gather.
  constexpr uint64_t kMostRows = (uint64_t{1} << 31) / 3;
  uint64_t rows = 0;
  for (size_t i = 0; i < meshes.size(); ++i)
    rows += meshes[i].keys[0].positions.size() / 3 * (static_cast<uint64_t>(segments[i]) + 1);
  const bool normals = std::any_of(meshes.begin(), meshes.end(), has_normals);
  const uint64_t floats = 3 * rows + kSpareFloats;
  if (rows > kMostRows || floats * sizeof(float) * (normals ? 2 : 1) > max_bytes)
    throw std::bad_alloc();
  positions_.reserve(floats);
  if (normals) normals_.reserve(floats);
}

void Deformations::add(const DeformingMesh& mesh, const std::vector<double>& times,
                       const motion::Interval& interval, int segments) {
  const auto first = static_cast<int32_t>(positions_.size() / 3);
  const size_t vertices = mesh.keys[0].positions.size() / 3;
  for (int step = 0; step <= segments; ++step) {
    const double share = segments > 0 ? static_cast<double>(step) / segments : 0;
    const KeyPlace place = place_of(times, interval.begin + share * interval.length());
    const scene::VertexKey &a = mesh.keys[place.key], &b = mesh.keys[place.next];
    append_step(a.positions, b.positions, place.share, positions_);
    append_step(a.normals, b.normals, place.share, normals_);
    if (normals_.capacity() > 0) normals_.resize(positions_.size(), 0.F);
  }
  first_of_mesh_.push_back(first);
  step_count_.push_back(segments + 1);
  vertex_count_.push_back(vertices);
  const auto shape = static_cast<size_t>(mesh.shape);
  first_row_[shape] = first;
  segments_[shape] = segments;
  rows_[shape] = static_cast<int32_t>(vertices);
  first_vertex_[shape] = mesh.first_vertex;
}

Mask Deformations::deforming(Int shape, Mask lanes) const {
  if (empty()) return no_lanes();
  return lanes & less(Int(-1), gather(first_row_.data(), shape, lanes));
}

DeformedCorners Deformations::at(Int shape, const Int corner[3], Float time, bool normals,
                                 Mask lanes) const {
  const Int segments = gather(segments_.data(), shape, lanes);
  const Int rows = gather(rows_.data(), shape, lanes);
  const Float place = time * to_float(segments);
  const Int segment = xsimd::max(xsimd::min(truncate(place), segments - Int(1)), Int(0));
  const Float share = place - to_float(segment), rest = Float(1.F) - share;
  const Int first = gather(first_row_.data(), shape, lanes) + segment * rows -
                    gather(first_vertex_.data(), shape, lanes);
  const Int to_next = select(less(segment, segments), rows, Int(0));
  const Vec3 no_normal = {Float(0.F), Float(0.F), Float(0.F)};
  DeformedCorners corners;
  for (int k = 0; k < 3; ++k) {
    const Int row = first + corner[k], next = row + to_next;
    const auto mixed = [&](const std::vector<float>& table) {
      return gather3(table.data(), row, lanes) * rest + gather3(table.data(), next, lanes) * share;
    };
    corners.position[k] = mixed(positions_);
    if (normals) corners.normal[k] = normals_.empty() ? no_normal : mixed(normals_);
  }
  return corners;
}

uint64_t Deformations::bytes() const {
  return (positions_.capacity() + normals_.capacity()) * sizeof(float) +
         (first_row_.capacity() + segments_.capacity() + rows_.capacity() +
          first_vertex_.capacity()) *
             sizeof(int32_t);
}

}  // namespace metrofarm::geometry
