#include "work_unit/render_target.h"

#include <limits>

#include "math/rng.h"
#include "work_unit/splat_lanes.h"

namespace metrofarm::work_unit {

using metropolis::Layer;
using metropolis::Which;

namespace {

// Trailing splats that are black in this lane are left out.
RenderTarget::Payload payload_of(const transport::Contribution& c, int lane) {
  RenderTarget::Payload out;
  out.light_vertices = static_cast<int32_t>(lane_word(as_uint(c.light_vertices), lane));
  size_t used = 1;
  for (const transport::Splat& s : c.splats) {
    out.splats.push_back({lane_value(s.raster_x, lane),
                          lane_value(s.raster_y, lane),
                          {lane_value(s.radiance.x, lane), lane_value(s.radiance.y, lane),
                           lane_value(s.radiance.z, lane)}});
    const float* rgb = out.splats.back().rgb;
    if (rgb[0] != 0 || rgb[1] != 0 || rgb[2] != 0) used = out.splats.size();
  }
  out.splats.resize(used);
  return out;
}

}  // namespace

std::vector<uint32_t> replayable(const std::vector<primary_space::StoredPair>& pairs) {
  std::vector<uint32_t> out;
  for (const primary_space::StoredPair& p : pairs) {
    out.resize(2 * (size_t(p.slot) + 1), 0);
    out[2 * size_t(p.slot)] = p.first;
    out[2 * size_t(p.slot) + 1] = p.second;
  }
  return out;
}

RenderTarget::RenderTarget(const Context& context, std::unique_ptr<transport::Estimator> estimator)
    : context_(context), estimator_(std::move(estimator)) {
  for (transport::Contribution& c : found_) c.reset();
}

void RenderTarget::begin_pack(film::Splatter* splatter, uint32_t group,
                              const metropolis::PackMembers& members) {
  splatter_ = splatter;
  destination_.half = static_cast<int>(group % film::kHalves);
  destination_.group = static_cast<int>(group % film::kStatisticsGroups);
  for (int lane = 0; lane < kLanes; ++lane)
    noise_[lane] = mix64(mix64(context_.spec().seed) + members.chains[lane]);
}

Float RenderTarget::evaluate(primary_space::SampleSource& source, Which into, Mask lanes) {
  transport::Contribution& c = all(lanes) ? found(into) : scratch_;
  estimator_->trace(source, context_.whole_raster(), lanes, c);
  // The sum of sound contributions can still leave the range of floats.
  const Spectrum total = c.total();
  const Float f = target_of(c, total, lanes);
  const Mask sound = diagnostics::sound(total) & (f <= Float(std::numeric_limits<float>::max()));
  if (!estimator_->incidents().empty()) log_incidents(source);
  if (any(lanes & ~sound)) {
    anomalies_.count(diagnostics::AnomalyKind::kInfinite);
    for (transport::Splat& s : c.splats) s.radiance = keep(sound, s.radiance);
  }
  if (!all(lanes)) found(into).take(scratch_, lanes);
  return keep(sound, f);
}

Float RenderTarget::target_of(const transport::Contribution& c, const Spectrum& total,
                              Mask lanes) const {
  const TargetMap& map = context_.target_map();
  if (map.empty()) return luminance(total);
  Float sum(0.F);
  for (const transport::Splat& s : c.splats) {
    const Mask lit = lanes & not_black(s.radiance);
    if (none(lit)) continue;
    const Float value = luminance(s.radiance) * map.factor(s.raster_x, s.raster_y, lit);
    sum = sum + keep(lit, value);
  }
  return sum;
}

void RenderTarget::add_proposal_to(LightMap& map) const {
  for (const transport::Splat& s : found(Which::kProposal).splats) {
    const Float brightness = luminance(s.radiance);
    for (uint32_t rest = bits(not_black(s.radiance)); rest != 0; rest &= rest - 1) {
      const int lane = __builtin_ctz(rest);
      map.add(lane_value(s.raster_x, lane), lane_value(s.raster_y, lane),
              lane_value(brightness, lane));
    }
  }
}

void RenderTarget::log_incidents(const primary_space::SampleSource& source) {
  for (const diagnostics::Incident& incident : estimator_->incidents()) {
    anomalies_.count(incident.kind);
    if (anomalies_.wants_sample())
      anomalies_.keep({incident, replayable(source.read_pairs(incident.lane))});
  }
}

void RenderTarget::observe(const metropolis::FirstStage& stage) {
  const transport::Contribution& c = found(Which::kProposal);
  lengths_.add(c.edges, bits(stage.accepted));
  if (context_.spec().integrator == Integrator::kMmlt)
    techniques_.add(c.light_vertices, bits(stage.accepted));
  if (context_.spec().acceptance_layer && splatter_ != nullptr) map_acceptance(stage);
}

void RenderTarget::map_acceptance(const metropolis::FirstStage& stage) {
  const transport::Contribution& c = found(Which::kProposal);
  Float x = c.splats[0].raster_x, y = c.splats[0].raster_y, brightest(0.F);
  for (const transport::Splat& s : c.splats) {
    const Float brightness = luminance(s.radiance);
    const Mask brighter = brightness > brightest;
    x = select(brighter, s.raster_x, x);
    y = select(brighter, s.raster_y, y);
    brightest = select(brighter, brightness, brightest);
  }
  destination_.layer = context_.acceptance_layer();
  constexpr auto kOne = static_cast<int64_t>(film::kFixedOne);
  for (int lane = 0; lane < kLanes; ++lane) {
    // Floats in [0, 1] are multiples of 2^-32 but for those that are tiny.
    const double acceptance = lane_value(stage.acceptance, lane);
    const int64_t v[film::kChannels] = {kOne, static_cast<int64_t>(acceptance * film::kFixedOne),
                                        (bits(stage.large) >> lane & 1) != 0 ? kOne : 0};
    splatter_->count(destination_, lane_value(x, lane), lane_value(y, lane), v);
  }
}

void RenderTarget::accept(Which from, Mask lanes) {
  found(Which::kCurrent).take(found(from), lanes);
}

void RenderTarget::record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) {
  if (none(lanes) || splatter_ == nullptr) return;
  const transport::Contribution& c = found(which);
  const uint64_t call = mix64(serial);
  uint64_t noise[kLanes];
  for (size_t i = 0; i < c.splats.size(); ++i) {
    const transport::Splat& s = c.splats[i];
    const Mask lit = lanes & not_black(s.radiance);
    // Splats of one call are dithered apart.
    for (int lane = 0; lane < kLanes; ++lane) noise[lane] = mix64(noise_[lane] ^ (call + i));
    destination_.layer = static_cast<int>(layer);
    splat_lanes(*splatter_, destination_, s, scale, lit, noise);
    if (!context_.spec().technique_layers) continue;
    // The same once more: the images by technique sum to the image to the last bit.
    const Int technique = xsimd::min(c.light_vertices, Int(kTechniqueImages - 1));
    for (int t = 0; t < kTechniqueImages; ++t) {
      destination_.layer = context_.technique_layer(t, layer);
      splat_lanes(*splatter_, destination_, s, scale, lit & equal(technique, Int(t)), noise);
    }
  }
}

RenderTarget::Payload RenderTarget::proposal(int lane) const {
  return payload_of(found(Which::kProposal), lane);
}
RenderTarget::Payload RenderTarget::current(int lane) const {
  return payload_of(found(Which::kCurrent), lane);
}

void RenderTarget::set_current(int lane, const Payload& payload) {
  transport::Contribution& current = found(Which::kCurrent);
  const std::vector<LaneSplat>& splats = payload.splats;
  UInt light_vertices = as_uint(current.light_vertices);
  set_lane_word(light_vertices, lane, static_cast<uint32_t>(payload.light_vertices));
  current.light_vertices = as_int(light_vertices);
  if (current.splats.size() < splats.size()) current.splats.resize(splats.size());
  for (size_t i = 0; i < current.splats.size(); ++i) {
    transport::Splat& s = current.splats[i];
    const LaneSplat p = i < splats.size() ? splats[i] : LaneSplat{};
    set_lane_value(s.raster_x, lane, p.x);
    set_lane_value(s.raster_y, lane, p.y);
    set_lane_value(s.radiance.x, lane, p.rgb[0]);
    set_lane_value(s.radiance.y, lane, p.rgb[1]);
    set_lane_value(s.radiance.z, lane, p.rgb[2]);
  }
}

}  // namespace metrofarm::work_unit
