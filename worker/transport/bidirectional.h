// Bidirectional path tracing (Veach 1997, chapter 10), eight paths side by side: a subpath from an
// emitter, one from the eye, and every way to join them, weighted by multiple importance sampling.
//
// Multiplexed (Hachisuka et al. 2014), each lane makes one path of one length by one technique.
#pragma once

#include <vector>

#include "sensor/camera.h"
#include "transport/estimator.h"
#include "transport/interaction.h"
#include "transport/mis.h"

namespace metrofarm::transport {

struct BidirectionalSettings {
  int max_depth = -1;  // edges; -1: no limit but kLongestPath
  int rr_depth = 5;    // first length of a subpath, in edges, at which roulette may end it
  bool hide_emitters = false;
  int min_depth = 1;  // paths of fewer edges are left out
};

// Which of the techniques that make a path are wanted.
struct Technique {
  bool all = true;
  Int edges = Int(0);           // of the whole path
  Int light_vertices = Int(0);  // s: 0 where the eye path meets the light by itself

  Mask includes(int of_edges, int of_light_vertices) const {
    if (all) return all_lanes();
    return equal(edges, Int(of_edges)) & equal(light_vertices, Int(of_light_vertices));
  }
  // Lanes whose light subpath, or eye subpath, of so many edges has to go on.
  Mask light_goes_on(int light_edges) const;
  Mask eye_goes_on(int eye_edges) const;
};

class BidirectionalTracer : public Estimator {
 public:
  // raster: all that the windows that trace() is given sample together, evenly.
  BidirectionalTracer(const Scene& scene, const sensor::Camera& camera,
                      const BidirectionalSettings& settings, const RasterWindow& raster);

  void trace(primary_space::SampleSource& source, const RasterWindow& window, Mask lanes,
             Contribution& out) override;

 protected:
  // Makes what `technique` names.
  void trace_technique(primary_space::SampleSource& source, const RasterWindow& window,
                       const Technique& technique, Mask lanes, Contribution& out);

  int depth_limit() const { return depth_limit_; }
  int min_depth() const { return settings_.min_depth; }

 private:
  enum class End { kEye, kLight };
  // A subpath's last ray and what it carries.
  struct Subpath {
    End end;
    Mask active;
    Vec3 origin{}, direction{};
    Spectrum throughput = splat(1.F);
    PartialMis mis{};
    emitter::Receiver from{};  // the vertex that the ray comes from
    Float eta2 = Float(1.F);   // product of squared index ratios, undone in the eye's roulette
  };
  // A vertex of the light subpath that the eye subpath can be joined to.
  struct LightVertex {
    Interaction at;
    Spectrum throughput;
    PartialMis mis;
    Mask lanes;
  };
  // What the parts of one trace() share.
  struct Sample {
    primary_space::SampleSource& source;
    const RasterWindow& window;
    const Technique& technique;
    Mask lanes;
    Contribution& out;
    FilmPoint film;       // of the eye subpath
    int light_edges = 0;  // of the light subpath
  };
  // A BSDF between the vertex's wo and another direction.
  struct Scattering {
    Spectrum value;  // with the cosine, and the adjoint factor where importance travels
    Float pdf, reverse_pdf;
  };

  void trace_light(Sample& sample);
  void trace_eye(Sample& sample);
  void add_vertex(Sample& sample, const Subpath& light, const Interaction& v, int edges);
  void connect_to_camera(Sample& sample, const LightVertex& v, int edges);

  Float row_weight(const Sample& sample, Float raster_y) const;
  void look_up(Sample& sample, const Subpath& path, int vertex, Interaction& v);
  Scattering scattering(End end, const Interaction& v, const Vec3& direction, Mask lanes) const;
  void scatter(Sample& sample, Subpath& path, const Interaction& v, int edges);
  void roulette(Subpath& path, Float u, const Spectrum& weight) const;

  void add_environment(Sample& sample, const Subpath& eye, Mask missed, int edges);
  void add_emission(Sample& sample, const Subpath& eye, const Interaction& v, int edges);
  void add_light_sample(Sample& sample, const Subpath& eye, const Interaction& v, int edges);
  void connect(Sample& sample, const Subpath& eye, const Interaction& v, int edges);
  Spectrum joined(const Subpath& eye, const Interaction& v, const LightVertex& light, Mask lanes);
  // Adds to what the eye path brings back.
  void add(Sample& sample, const Spectrum& found, Mask lanes, diagnostics::Place place, int edges);

  const Scene& scene_;
  const sensor::Camera& camera_;
  BidirectionalSettings settings_;
  int depth_limit_;
  RasterWindow raster_;
  Float raster_area_;                        // square pixels
  Float area_unit_;                          // squared radius of the scene
  std::vector<LightVertex> light_vertices_;  // by edges from the emitter, less one
};

}  // namespace metrofarm::transport
