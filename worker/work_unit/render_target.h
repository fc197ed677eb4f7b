// The renderer as a chain's target: f is the luminance that a path brings back.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "diagnostics/anomalies.h"
#include "film/film.h"
#include "metropolis/mutated_sample.h"
#include "metropolis/target.h"
#include "transport/estimator.h"
#include "work_unit/context.h"

namespace metrofarm::work_unit {

class RenderTarget final : public metropolis::Target {
 public:
  // The estimator is the context's, unless another is given.
  explicit RenderTarget(const Context& context) : RenderTarget(context, context.make_estimator()) {}
  RenderTarget(const Context& context, std::unique_ptr<transport::Estimator> estimator);

  // Where record() splats, nowhere if null; the chains' group, and which they are.
  void begin_pack(film::Splatter* splatter, uint32_t group, const metropolis::PackMembers& members);

  Float evaluate(primary_space::SampleSource& source, metropolis::Which into, Mask lanes) override;
  void accept(metropolis::Which from, Mask lanes) override;
  void record(metropolis::Which which, metropolis::Layer layer, Float scale, Mask lanes,
              uint64_t serial) override;
  void observe(const metropolis::FirstStage& stage) override;

  // The proposal of one lane becomes the current state of another: a chain starts from its seed.
  // Source and destination are kept apart by storing into `to` only.
  struct LaneSplat {
    float x, y, rgb[3];
  };
  struct Payload {
    std::vector<LaneSplat> splats;
    int32_t light_vertices = 0;  // see transport::Contribution
  };
  Payload proposal(int lane) const;
  Payload current(int lane) const;
  void set_current(int lane, const Payload& payload);

  // Adds what the last proposals brought back, in all lanes.
  void add_proposal_to(LightMap& map) const;

  const transport::PathCosts& costs() const { return estimator_->costs(); }
  const diagnostics::AnomalyLog& anomalies() const { return anomalies_; }
  // First stages by length and by technique, all packs together.
  const Shares& lengths() const { return lengths_; }
  const Shares& techniques() const { return techniques_; }

 private:
  transport::Contribution& found(metropolis::Which which) {
    return found_[static_cast<int>(which)];
  }
  const transport::Contribution& found(metropolis::Which which) const {
    return found_[static_cast<int>(which)];
  }
  // f: luminance, over the target map where there is one.
  Float target_of(const transport::Contribution& c, const Spectrum& total, Mask lanes) const;
  void log_incidents(const primary_space::SampleSource& source);
  // Counts the proposals where they would land.
  void map_acceptance(const metropolis::FirstStage& stage);

  const Context& context_;
  std::unique_ptr<transport::Estimator> estimator_;
  std::array<transport::Contribution, metropolis::kStates> found_;  // by metropolis::Which
  transport::Contribution scratch_;
  diagnostics::AnomalyLog anomalies_;
  Shares lengths_, techniques_;
  film::Splatter* splatter_ = nullptr;
  film::Destination destination_;
  uint64_t noise_[kLanes] = {};
};

// Element 2 s and 2 s + 1 are the pair in slot s, 0 where unread.
std::vector<uint32_t> replayable(const std::vector<primary_space::StoredPair>& pairs);

}  // namespace metrofarm::work_unit
