#include "tests/metropolis/branching_target.h"

#include <cmath>

#include "tests/support/lane_tools.h"

namespace metrofarm::metropolis::test {
namespace {

using primary_space::Pair;

Float ridge(Float distance) {
  return xsimd::exp(Float(-0.5F) * sqr(distance * Float(1 / BranchingTarget::kRidge)));
}

bool in_core(double x, double y) {
  return std::fabs(x - y) < 0.5 * BranchingTarget::kRidge;
}

// Integral of ridge(x - y) over a rectangle, where (x, y) lies in the core or anywhere.
double ridge_integral(double x0, double x1, double y0, double y1, bool core) {
  // Exact in y, midpoint rule in x.
  const double s = BranchingTarget::kRidge * std::sqrt(2.0), half = 0.5 * BranchingTarget::kRidge;
  constexpr int kSteps = 20000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = x0 + (x1 - x0) * (i + 0.5) / kSteps;
    const double low = core ? std::max(y0, x - half) : y0;
    const double high = core ? std::min(y1, x + half) : y1;
    if (high > low) sum += std::erf((high - x) / s) - std::erf((low - x) / s);
  }
  return sum * (x1 - x0) / kSteps * 0.5 * std::sqrt(std::numbers::pi) * s;
}

// Area of the part of a rectangle that lies in the core.
double core_area(double x0, double x1, double y0, double y1) {
  const double half = 0.5 * BranchingTarget::kRidge;
  constexpr int kSteps = 20000;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = x0 + (x1 - x0) * (i + 0.5) / kSteps;
    sum += std::max(0.0, std::min(y1, x + half) - std::max(y0, x - half));
  }
  return sum * (x1 - x0) / kSteps;
}

double first_branch(double a0, double a1, double b0, double b1, bool core) {
  b1 = std::min(b1, 0.9);
  if (b1 <= b0) return 0;
  const double area = core ? core_area(a0, a1, b0, b1) : (a1 - a0) * (b1 - b0);
  return 0.2 * area + 3 * ridge_integral(a0, a1, b0, b1, core);
}

double second_branch(double c0, double c1, double d0, double d1, bool core) {
  constexpr double kAreaOfFirstPair = 0.5 * 0.9;
  const auto area = [&](double from, double to) {
    return core ? core_area(from, to, d0, d1) : (to - from) * (d1 - d0);
  };
  static const double third_pair = ridge_integral(0, 1, 0, 1, false);
  const double deep = c0 < 0.4 ? area(c0, std::min(c1, 0.4)) : 0;
  return kAreaOfFirstPair *
         (0.1 * area(c0, c1) + 2 * ridge_integral(c0, c1, d0, d1, core) + 4 * third_pair * deep);
}

std::vector<double> integrate_bins() {
  std::vector<double> out;
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 10; ++j)
      out.push_back(first_branch(0.1 * i, 0.1 * (i + 1), 0.1 * j, 0.1 * (j + 1), false));
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 10; ++j)
      out.push_back(second_branch(0.1 * i, 0.1 * (i + 1), 0.1 * j, 0.1 * (j + 1), false));
  out.push_back(first_branch(0, 0.5, 0, 1, true));
  out.push_back(second_branch(0, 1, 0, 1, true));
  return out;
}

int cell(double v, int count) {
  return std::min(static_cast<int>(v * count), count - 1);
}

}  // namespace

Float BranchingTarget::evaluate(primary_space::SampleSource& source, Which into, Mask lanes) {
  const Pair ab = source.pair(kBranchingSlots[0], lanes);
  const Mask deeper = lanes & (ab.first >= Float(0.5F));
  const Mask second_lanes = eager_ ? lanes : deeper;
  Pair cd{Float(0.F), Float(0.F)}, eg = cd;
  if (any(second_lanes)) cd = source.pair(kBranchingSlots[1], second_lanes);
  const Mask deepest = deeper & (cd.first < Float(0.4F));
  const Mask third_lanes = eager_ ? lanes : deepest;
  if (any(third_lanes)) eg = source.pair(kBranchingSlots[2], third_lanes);

  const Float shallow = Float(0.2F) + Float(3.F) * ridge(ab.first - ab.second);
  const Float deep = Float(0.1F) + Float(2.F) * ridge(cd.first - cd.second) +
                     keep(deepest, Float(4.F) * ridge(eg.first - eg.second));
  const Float f = keep(ab.second < Float(0.9F), select(deeper, deep, shallow));
  take(into, {f, {ab.first, ab.second, cd.first, cd.second}}, lanes);
  return f;
}

void BranchingTarget::take(Which into, const Found& found, Mask lanes) {
  Found& to = found_[static_cast<int>(into)];
  to.f = select(lanes, found.f, to.f);
  for (int i = 0; i < 4; ++i) to.x[i] = select(lanes, found.x[i], to.x[i]);
}

void BranchingTarget::accept(Which from, Mask lanes) {
  take(Which::kCurrent, found_[static_cast<int>(from)], lanes);
}

void BranchingTarget::record(Which which, Layer layer, Float scale, Mask lanes,
                             uint64_t /*serial*/) {
  for (int lane = 0; lane < kLanes; ++lane) {
    if (!metrofarm::test::lane_set(lanes, lane)) continue;
    const Payload p = payload(which, lane);
    sink_({which, layer, lane, lane_value(scale, lane), p.f, bins_of(p)});
  }
}

BranchingTarget::Bins BranchingTarget::bins_of(const Payload& p) {
  const bool shallow = p.x[0] < 0.5F;
  const double x = p.x[shallow ? 0 : 2], y = p.x[shallow ? 1 : 3];
  Bins bins{};
  bins.cell = shallow ? cell(2 * x, 5) * 10 + cell(y, 10) : 50 + cell(x, 10) * 10 + cell(y, 10);
  bins.core = !in_core(x, y) ? -1 : shallow ? kBins - 2 : kBins - 1;
  return bins;
}

BranchingTarget::Payload BranchingTarget::payload(Which which, int lane) const {
  const Found& found = found_[static_cast<int>(which)];
  Payload p{lane_value(found.f, lane), {}};
  for (int i = 0; i < 4; ++i) p.x[i] = lane_value(found.x[i], lane);
  return p;
}

void BranchingTarget::set_current(int lane, const Payload& p) {
  Found& current = found_[static_cast<int>(Which::kCurrent)];
  set_lane_value(current.f, lane, p.f);
  for (int i = 0; i < 4; ++i) set_lane_value(current.x[i], lane, p.x[i]);
}

double BranchingTarget::integral() {
  static const double sum = first_branch(0, 0.5, 0, 1, false) + second_branch(0, 1, 0, 1, false);
  return sum;
}

const std::vector<double>& BranchingTarget::bin_integrals() {
  static const std::vector<double> bins = integrate_bins();
  return bins;
}

std::vector<ExactStart> exact_starts(bool eager, size_t count, uint64_t seed) {
  BranchingTarget target(eager);
  primary_space::IndependentSource source(rng_key(seed, RngDomain::kBootstrap));
  metrofarm::test::UniformLanes coins(seed);
  std::vector<ExactStart> out;
  for (uint64_t first = 0; out.size() < count; first += kLanes) {
    source.begin(first);
    const Float f = target.evaluate(source, Which::kProposal, all_lanes());
    const Float height = coins.next() * Float(static_cast<float>(BranchingTarget::kLargest));
    for (int lane = 0; lane < kLanes && out.size() < count; ++lane) {
      if (lane_value(height, lane) < lane_value(f, lane))
        out.push_back({target.proposal(lane), source.read_pairs(lane)});
    }
  }
  return out;
}

}  // namespace metrofarm::metropolis::test
