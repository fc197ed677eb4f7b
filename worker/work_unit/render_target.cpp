#include "work_unit/render_target.h"

#include "math/rng.h"

namespace metrofarm::work_unit {

using metropolis::Layer;
using metropolis::Which;

namespace {

RenderTarget::Payload payload_of(const transport::Contribution& c, int lane) {
  return {lane_value(c.raster_x, lane),
          lane_value(c.raster_y, lane),
          {lane_value(c.radiance.x, lane), lane_value(c.radiance.y, lane),
           lane_value(c.radiance.z, lane)}};
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

RenderTarget::RenderTarget(const Context& context)
    : context_(context), tracer_(context.scene(), context.camera(), context.spec().path) {}

void RenderTarget::begin_pack(film::Splatter* splatter, uint32_t group, uint32_t first_chain) {
  splatter_ = splatter;
  destination_.half = static_cast<int>(group % film::kHalves);
  destination_.group = static_cast<int>(group % film::kStatisticsGroups);
  for (int lane = 0; lane < kLanes; ++lane)
    noise_[lane] = mix64(mix64(context_.spec().seed) + first_chain + lane);
}

Float RenderTarget::evaluate(primary_space::SampleSource& source) {
  proposal_ = tracer_.trace(source, context_.whole_raster(), all_lanes());
  // The sum of sound contributions can still leave the range of floats.
  const Mask sound = diagnostics::sound(proposal_.radiance);
  if (!tracer_.incidents().empty()) log_incidents(source);
  if (!all(sound)) {
    anomalies_.count(diagnostics::AnomalyKind::kInfinite);
    proposal_.radiance = keep(sound, proposal_.radiance);
  }
  return luminance(proposal_.radiance);
}

void RenderTarget::log_incidents(const primary_space::SampleSource& source) {
  for (const diagnostics::Incident& incident : tracer_.incidents()) {
    anomalies_.count(incident.kind);
    if (anomalies_.wants_sample())
      anomalies_.keep({incident, replayable(source.read_pairs(incident.lane))});
  }
}

void RenderTarget::accept(Mask lanes) {
  current_.raster_x = select(lanes, proposal_.raster_x, current_.raster_x);
  current_.raster_y = select(lanes, proposal_.raster_y, current_.raster_y);
  current_.radiance = select(lanes, proposal_.radiance, current_.radiance);
}

void RenderTarget::record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) {
  if (none(lanes)) return;
  const transport::Contribution& c = which == Which::kCurrent ? current_ : proposal_;
  const Spectrum value = c.radiance * scale;
  alignas(32) float x[kLanes], y[kLanes], r[kLanes], g[kLanes], b[kLanes];
  c.raster_x.store_aligned(x);
  c.raster_y.store_aligned(y);
  value.x.store_aligned(r);
  value.y.store_aligned(g);
  value.z.store_aligned(b);
  destination_.layer = static_cast<int>(layer);
  for (uint32_t rest = bits(lanes); rest != 0; rest &= rest - 1) {
    const int lane = __builtin_ctz(rest);
    const float rgb[3] = {r[lane], g[lane], b[lane]};
    splatter_->splat(destination_, x[lane], y[lane], rgb, mix64(noise_[lane] ^ mix64(serial)));
  }
}

RenderTarget::Payload RenderTarget::proposal(int lane) const {
  return payload_of(proposal_, lane);
}
RenderTarget::Payload RenderTarget::current(int lane) const {
  return payload_of(current_, lane);
}

void RenderTarget::set_current(int lane, const Payload& p) {
  set_lane_value(current_.raster_x, lane, p.x);
  set_lane_value(current_.raster_y, lane, p.y);
  set_lane_value(current_.radiance.x, lane, p.rgb[0]);
  set_lane_value(current_.radiance.y, lane, p.rgb[1]);
  set_lane_value(current_.radiance.z, lane, p.rgb[2]);
}

}  // namespace metrofarm::work_unit
