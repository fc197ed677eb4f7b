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

// In these lanes `to` becomes `from`.
void take(transport::Contribution& to, const transport::Contribution& from, Mask lanes) {
  to.raster_x = select(lanes, from.raster_x, to.raster_x);
  to.raster_y = select(lanes, from.raster_y, to.raster_y);
  to.radiance = select(lanes, from.radiance, to.radiance);
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

Float RenderTarget::evaluate(primary_space::SampleSource& source, Which into, Mask lanes) {
  transport::Contribution c = tracer_.trace(source, context_.whole_raster(), lanes);
  // The sum of sound contributions can still leave the range of floats.
  const Mask sound = diagnostics::sound(c.radiance);
  if (!tracer_.incidents().empty()) log_incidents(source);
  if (!all(sound)) {
    anomalies_.count(diagnostics::AnomalyKind::kInfinite);
    c.radiance = keep(sound, c.radiance);
  }
  take(found(into), c, lanes);
  return luminance(c.radiance);
}

void RenderTarget::log_incidents(const primary_space::SampleSource& source) {
  for (const diagnostics::Incident& incident : tracer_.incidents()) {
    anomalies_.count(incident.kind);
    if (anomalies_.wants_sample())
      anomalies_.keep({incident, replayable(source.read_pairs(incident.lane))});
  }
}

void RenderTarget::accept(Which from, Mask lanes) {
  take(found(Which::kCurrent), found(from), lanes);
}

void RenderTarget::record(Which which, Layer layer, Float scale, Mask lanes, uint64_t serial) {
  if (none(lanes)) return;
  const transport::Contribution& c = found(which);
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
  return payload_of(found(Which::kProposal), lane);
}
RenderTarget::Payload RenderTarget::current(int lane) const {
  return payload_of(found(Which::kCurrent), lane);
}

void RenderTarget::set_current(int lane, const Payload& p) {
  transport::Contribution& current = found(Which::kCurrent);
  set_lane_value(current.raster_x, lane, p.x);
  set_lane_value(current.raster_y, lane, p.y);
  set_lane_value(current.radiance.x, lane, p.rgb[0]);
  set_lane_value(current.radiance.y, lane, p.rgb[1]);
  set_lane_value(current.radiance.z, lane, p.rgb[2]);
}

}  // namespace metrofarm::work_unit
