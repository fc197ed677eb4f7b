#include "emitter/environment_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "emitter/light_weight.h"
#include "emitter/linear_map.h"
#include "emitter/lookup.h"

namespace metrofarm::emitter {
namespace {

constexpr double kPiDouble = std::numbers::pi;
constexpr float kInvTwoPi = 0.5F * kInvPi;

Vec3 apply(const std::array<float, 9>& m, const Vec3& v) {
  return {Float(m[0]) * v.x + Float(m[1]) * v.y + Float(m[2]) * v.z,
          Float(m[3]) * v.x + Float(m[4]) * v.y + Float(m[5]) * v.z,
          Float(m[6]) * v.x + Float(m[7]) * v.y + Float(m[8]) * v.z};
}

template <class T>
T mix(const T& a, const T& b, Float t) {
  return a * (Float(1.F) - t) + b * t;
}

}  // namespace

EnvironmentMap::EnvironmentMap(const scene::EnvironmentEmitter& emitter,
                               const texture::Images& images)
    : images_(images),
      image_(emitter.image),
      scale_(emitter.scale),
      width_(images.width(emitter.image)),
      height_(images.height(emitter.image)),
      rows_(std::max(height_ - 1, 1)) {
  const scene::Linear forward = turn(emitter.to_world), backward = inverse_turn(emitter.to_world);
  for (int k = 0; k < 9; ++k) {
    to_world_[k] = static_cast<float>(forward[k]);
    to_local_[k] = static_cast<float>(backward[k]);
  }
  measure_rows();
  build_tables();
}

void EnvironmentMap::measure_rows() {
  for (int row = 0; row <= rows_; ++row) {
    const double half = kPiDouble * row / rows_ / 2;
    const double sine = std::sin(half), cosine = row == rows_ ? 0 : std::cos(half);
    from_top_.push_back(static_cast<float>(sine * sine));
    from_bottom_.push_back(static_cast<float>(cosine * cosine));
  }
}

void EnvironmentMap::build_tables() {
  column_cdf_.resize(size_t(width_) * rows_);
  std::vector<double> power(rows_), bands(rows_);
  std::vector<float> upper, lower;  // weights of the pixels at a row's edges
  weigh_row(0, lower);
  for (int row = 0; row < rows_; ++row) {
    std::swap(upper, lower);
    weigh_row(std::min(row + 1, height_ - 1), lower);
    const double angle = kPiDouble / rows_;
    // cos a - cos b without cancellation.
    bands[row] = 2 * std::sin((row + 0.5) * angle) * std::sin(angle / 2);
    power[row] = add_row(upper, lower, row) * bands[row];
  }
  row_cdf_.resize(rows_);
  pdf_of_row_.assign(rows_, 0.F);
  const double total = std::accumulate(power.begin(), power.end(), 0.0);
  // Of the sphere: bands of 2 pi / width each, divided by 4 pi.
  mean_weight_ = total / width_ / 2 * scale_;
  if (!(total > 0)) return;
  std::vector<float> picks(rows_);
  quantize_cdf(power, row_cdf_, picks);
  for (int row = 0; row < rows_; ++row)
    pdf_of_row_[row] = static_cast<float>(picks[row] * width_ / (2 * kPiDouble * bands[row]));
}

// A row's conditional distribution; returns the sum of the cells' mean weights.
double EnvironmentMap::add_row(const std::vector<float>& upper, const std::vector<float>& lower,
                               int row) {
  std::vector<double> weights(width_);
  for (int x = 0; x < width_; ++x) {
    const int next = x + 1 == width_ ? 0 : x + 1;
    weights[x] = (double(upper[x]) + upper[next] + lower[x] + lower[next]) / 4;
  }
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  std::vector<float> picks(width_);
  const auto count = static_cast<size_t>(width_);
  if (total > 0) quantize_cdf(weights, {&column_cdf_[row * count], count}, picks);
  return total;
}

void EnvironmentMap::weigh_row(int row, std::vector<float>& weights) const {
  weights.resize((size_t(width_) + kLanes - 1) / kLanes * kLanes);
  const Int lane(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
  for (int x = 0; x < width_; x += kLanes) {
    const Mask inside = first_lanes(std::min(width_ - x, kLanes));
    const Spectrum pixels = images_.pixel(Int(image_), lane + Int(x), Int(row), inside);
    weight_of(pixels).store_unaligned(&weights[x]);
  }
}

EnvironmentMap::Cell EnvironmentMap::cell_at(Int column, Int row) const {
  const Int next = column + Int(1);
  return {column, select(equal(next, Int(width_)), Int(0), next), row,
          height_ == 1 ? row : row + Int(1)};
}

Float EnvironmentMap::fraction_of_cosine(const Latitude& at, Int row, Mask lanes) const {
  const auto fraction = [&](const float* table, Float value) {
    const Float first = gather(table, row, lanes);
    return (value - first) / (gather(table + 1, row, lanes) - first);
  };
  const Mask northern = at.from_top < at.from_bottom;
  const Float t = select(northern, fraction(from_top_.data(), at.from_top),
                         fraction(from_bottom_.data(), at.from_bottom));
  return xsimd::min(xsimd::max(t, Float(0.F)), Float(1.F));
}

EnvironmentMap::Place EnvironmentMap::place_of(const Vec3& local, Mask lanes) const {
  const Float ring2 = sqr(local.x) + sqr(local.z);
  // 1 - |cos| = sin^2 / (1 + |cos|).
  const Float near = Float(0.5F) * ring2 / (Float(1.F) + xsimd::abs(local.y));
  const Float far = Float(1.F) - near;
  const Mask northern = local.y > Float(0.F);
  const Latitude latitude{select(northern, near, far), select(northern, far, near)};

  const Float size(static_cast<float>(width_));
  // From the centre of column 0 on; within [-1, width).
  const Mask pole = ring2 == Float(0.F);  // of any azimuth
  const Float z = select(pole, Float(1.F), -local.z);
  const Float turns = xsimd::atan2(local.x, z) * Float(kInvTwoPi);
  const Float u = turns * size - Float(0.5F);
  const Float x = select(u < Float(0.F), u + size, u);
  const Float column = xsimd::max(xsimd::min(xsimd::floor(x), size - Float(1.F)), Float(0.F));
  const Float y =
      xsimd::atan2(xsimd::sqrt(ring2), local.y) * Float(kInvPi * static_cast<float>(rows_));
  const Float row = xsimd::min(xsimd::floor(y), Float(static_cast<float>(rows_ - 1)));

  // Where the direction is no number, min and max give their second operand: the cell stays inside
  // the image and the fractions are no numbers.
  Place place;
  place.cell = cell_at(truncate(keep(lanes, column)), truncate(keep(lanes, row)));
  place.across = xsimd::min(Float(1.F), x - column);
  place.down = xsimd::min(Float(1.F), y - row);
  place.drop = fraction_of_cosine(latitude, place.cell.row, lanes);
  return place;
}

EnvironmentMap::Corners EnvironmentMap::corners(const Cell& c, Mask lanes) const {
  const auto pixel = [&](Int x, Int y) { return images_.pixel(Int(image_), x, y, lanes); };
  return {pixel(c.column, c.row), pixel(c.next_column, c.row), pixel(c.column, c.next_row),
          pixel(c.next_column, c.next_row)};
}

Spectrum EnvironmentMap::radiance(const Vec3& direction, Mask lanes) const {
  const Place p = place_of(normalize(apply(to_local_, direction)), lanes);
  const Corners c = corners(p.cell, lanes);
  const Spectrum value =
      mix(mix(c.upper, c.upper_next, p.across), mix(c.lower, c.lower_next, p.across), p.down);
  return keep(lanes, value * Float(scale_));
}

// Of the cell's column within its row.
Float EnvironmentMap::pick_of_column(const Cell& cell, Mask lanes) const {
  const Int at = cell.row * Int(width_) + cell.column;
  const Mask later = lanes & ~equal(cell.column, Int(0));
  return gather(column_cdf_.data(), at, lanes) - gather(column_cdf_.data(), at - Int(1), later);
}

Float EnvironmentMap::pdf_solid_angle(const Vec3& direction, Mask lanes) const {
  const Vec3 local = apply(to_local_, direction);
  const Float size = length(local);
  const Place p = place_of(local / size, lanes);
  const Corners c = corners(p.cell, lanes);
  const Float upper = weight_of(c.upper), upper_next = weight_of(c.upper_next);
  const Float lower = weight_of(c.lower), lower_next = weight_of(c.lower_next);
  const Float weight =
      mix(mix(upper, upper_next, p.across), mix(lower, lower_next, p.across), p.drop);
  const Float quarter(0.25F);  // before the sum, which might overflow
  const Float mean =
      (upper * quarter + upper_next * quarter) + (lower * quarter + lower_next * quarter);
  // The probability of the cell, spread over it in proportion to the weight.
  const Float cell = pick_of_column(p.cell, lanes) * gather(pdf_of_row_.data(), p.cell.row, lanes);
  const Mask lit = lanes & (mean > Float(0.F));
  // A map that shears magnifies solid angles by 1 / size^3 (its determinant is 1).
  return keep(lit, cell * (weight / mean) / (size * size * size));
}

Vec3 EnvironmentMap::sample(Vec2 u, Mask lanes) const {
  const Found row = find_in_cdf(row_cdf_.data(), Int(0), rows_, u.y, lanes);
  const Int first = row.index * Int(width_);
  const Found column = find_in_cdf(column_cdf_.data(), first, width_, u.x, lanes);
  const Corners c = corners(cell_at(column.index, row.index), lanes);
  const Float upper = weight_of(c.upper), upper_next = weight_of(c.upper_next);
  const Float lower = weight_of(c.lower), lower_next = weight_of(c.lower_next);
  const Float drop = sample_linear(upper + upper_next, lower + lower_next, row.rest);
  const Float across =
      sample_linear(mix(upper, lower, drop), mix(upper_next, lower_next, drop), column.rest);

  const auto latitude = [&](const float* table) {
    return mix(gather(table, row.index, lanes), gather(table + 1, row.index, lanes), drop);
  };
  const Float top = latitude(from_top_.data()), bottom = latitude(from_bottom_.data());
  const Float ring = Float(2.F) * safe_sqrt(top * bottom);
  const Float turns =
      (to_float(column.index) + across + Float(0.5F)) * Float(1.F / static_cast<float>(width_));
  const SinCos a = sincos_turn(turns - xsimd::floor(turns));
  const Vec3 local{ring * a.sin, bottom - top, -ring * a.cos};
  return normalize(apply(to_world_, local));
}

uint64_t EnvironmentMap::bytes() const {
  return (from_top_.capacity() + from_bottom_.capacity() + row_cdf_.capacity() +
          pdf_of_row_.capacity() + column_cdf_.capacity()) *
         sizeof(float);
}

}  // namespace metrofarm::emitter
