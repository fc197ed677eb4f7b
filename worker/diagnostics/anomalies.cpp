#include "diagnostics/anomalies.h"

#include <cmath>

namespace metrofarm::diagnostics {
namespace {

AnomalyKind kind_of(const float rgb[3]) {
  if (std::isnan(rgb[0]) || std::isnan(rgb[1]) || std::isnan(rgb[2])) return AnomalyKind::kNan;
  if (std::isinf(rgb[0]) || std::isinf(rgb[1]) || std::isinf(rgb[2])) return AnomalyKind::kInfinite;
  return AnomalyKind::kNegative;
}

}  // namespace

const char* name_of(Place place) {
  switch (place) {
    case Place::kEmission:
      return "emission";
    case Place::kEmitterSample:
      return "emitter_sample";
    case Place::kEnvironment:
      return "environment";
    case Place::kScattering:
      return "scattering";
    case Place::kFilm:
      return "film";
    case Place::kConnection:
      return "connection";
    case Place::kCameraConnection:
      return "camera_connection";
  }
  return "film";
}

void AnomalyLog::merge(const AnomalyLog& other) {
  for (size_t k = 0; k < counts_.size(); ++k) counts_[k] += other.counts_[k];
  for (const Anomaly& a : other.samples_) keep(a);
}

void report(Mask bad, const Vec3& contribution, Place place, int depth,
            std::vector<Incident>& out) {
  alignas(32) float r[kLanes], g[kLanes], b[kLanes];
  contribution.x.store_aligned(r);
  contribution.y.store_aligned(g);
  contribution.z.store_aligned(b);
  for (uint32_t rest = bits(bad); rest != 0; rest &= rest - 1) {
    const int lane = __builtin_ctz(rest);
    const float rgb[3] = {r[lane], g[lane], b[lane]};
    out.push_back({kind_of(rgb), place, static_cast<uint16_t>(depth), static_cast<uint8_t>(lane)});
  }
}

}  // namespace metrofarm::diagnostics
