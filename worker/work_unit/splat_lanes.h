// From lanes to the film.
#pragma once

#include "film/film.h"
#include "transport/estimator.h"

namespace metrofarm::work_unit {

// Splats scale times the radiance of each of `lanes`; noise: of each lane, dithers the rounding.
inline void splat_lanes(film::Splatter& splatter, const film::Destination& destination,
                        const transport::Splat& s, Float scale, Mask lanes,
                        const uint64_t noise[kLanes]) {
  if (none(lanes)) return;
  const Spectrum value = s.radiance * scale;
  alignas(32) float x[kLanes], y[kLanes], r[kLanes], g[kLanes], b[kLanes];
  s.raster_x.store_aligned(x);
  s.raster_y.store_aligned(y);
  value.x.store_aligned(r);
  value.y.store_aligned(g);
  value.z.store_aligned(b);
  for (uint32_t rest = bits(lanes); rest != 0; rest &= rest - 1) {
    const int lane = __builtin_ctz(rest);
    const float rgb[3] = {r[lane], g[lane], b[lane]};
    splatter.splat(destination, x[lane], y[lane], rgb, noise[lane]);
  }
}

}  // namespace metrofarm::work_unit
