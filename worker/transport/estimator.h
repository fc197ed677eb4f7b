// What turns a primary sample into splats: path tracing, bidirectional path tracing, or one
// technique of it at a time.
#pragma once

#include <vector>

#include "diagnostics/anomalies.h"
#include "primary_space/sample_source.h"
#include "sensor/camera.h"
#include "spectrum/rgb.h"

namespace metrofarm::transport {

// Maps the film pair's unit square to raster positions in pixels, per lane.
struct RasterWindow {
  Float x, y;  // upper left corner
  Float width, height;
};

// A raster position, in both axes, beyond every film: of paths that have no place on it.
inline constexpr float kOffFilm = -0x1p20F;

// Light on the film.
struct Splat {
  Float raster_x = Float(0.F);  // pixels
  Float raster_y = Float(0.F);
  Spectrum radiance = splat(0.F);
};

// What one primary sample brings back. Splat 0 belongs to the eye path and has its raster position,
// black or not; those after it are light that paths from emitters carry to the camera. Lanes that
// have nothing are black.
struct Contribution {
  std::vector<Splat> splats;
  // Multiplexed: edges of the path and vertices of its light subpath. Else: edges that the eye path
  // followed, and 0.
  Int edges = Int(0);
  Int light_vertices = Int(0);

  void reset() {
    splats.assign(1, {Float(kOffFilm), Float(kOffFilm), splat(0.F)});
    edges = light_vertices = Int(0);
  }
  // Adds to splat i, whose raster position it sets.
  void add(size_t i, const Splat& splat, Mask lanes);
  // Sum over all splats.
  Spectrum total() const;
  // In these lanes becomes the other's.
  void take(const Contribution& other, Mask lanes);
  void scale(Float factor);
};

struct PathCosts {
  uint64_t paths = 0;
  uint64_t rays = 0;
};

// One per thread: keeps costs and incidents.
class Estimator {
 public:
  virtual ~Estimator() = default;

  // Evaluates the primary samples of the active lanes. Bad contributions are zero and listed in
  // incidents().
  virtual void trace(primary_space::SampleSource& source, const RasterWindow& window, Mask lanes,
                     Contribution& out) = 0;

  const PathCosts& costs() const { return costs_; }
  // Incidents of the last trace().
  const std::vector<diagnostics::Incident>& incidents() const { return incidents_; }

 protected:
  void begin(Mask lanes, Contribution& out);
  // Gives the radiance that has been found the brightness that the shutter's exposure means.
  static void expose(const sensor::Camera& camera, Contribution& out);
  void count_rays(Mask lanes) { costs_.rays += __builtin_popcount(bits(lanes)); }
  // Keeps what is sound of a contribution and lists the rest.
  Spectrum quarantine(const Spectrum& contribution, Mask lanes, diagnostics::Place place,
                      int depth);

  PathCosts costs_;
  std::vector<diagnostics::Incident> incidents_;
};

}  // namespace metrofarm::transport
