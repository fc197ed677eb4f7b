#include "rpc/convert.h"

#include <algorithm>
#include <cmath>

#include "rpc/structure.h"
#include "scene/kinds.h"

namespace metrofarm::rpc {

using metrofarm::scene::v1::SceneReport;

namespace {

metrofarm::scene::v1::Filter filter_of(metrofarm::scene::ReconstructionFilter filter) {
  switch (filter) {
    case metrofarm::scene::ReconstructionFilter::kBox:
      return metrofarm::scene::v1::FILTER_BOX;
    case metrofarm::scene::ReconstructionFilter::kTent:
      return metrofarm::scene::v1::FILTER_TENT;
    case metrofarm::scene::ReconstructionFilter::kGaussian:
      return metrofarm::scene::v1::FILTER_GAUSSIAN;
    case metrofarm::scene::ReconstructionFilter::kMitchell:
      return metrofarm::scene::v1::FILTER_MITCHELL;
    case metrofarm::scene::ReconstructionFilter::kCatmullRom:
      return metrofarm::scene::v1::FILTER_CATMULL_ROM;
    case metrofarm::scene::ReconstructionFilter::kLanczos:
      return metrofarm::scene::v1::FILTER_LANCZOS;
  }
  return metrofarm::scene::v1::FILTER_UNSPECIFIED;
}

// A scene may have any number of lights and of faults; a report that people read has not.
constexpr int kLightsListed = 1000;
constexpr size_t kWarningsListed = 100;

std::string place_of(const SourceLocation& where) {
  if (where.file.empty()) return "";
  return where.file + ":" + std::to_string(where.line);
}

// The lights of the scene, where the file has them; one for each shape that shines.
void list_lights(const metrofarm::scene::SceneDescription& d, SceneReport& report) {
  const auto add = [&](const metrofarm::scene::Emitter& emitter, const SourceLocation& where) {
    if (report.lights_size() == kLightsListed) return;
    auto& light = *report.add_lights();
    light.set_kind(kind_of(emitter));
    light.set_place(place_of(where));
  };
  for (const auto& shape : d.shapes)
    if (shape.area_emitter != metrofarm::scene::kNone)
      add(d.emitters[shape.area_emitter], shape.where);
  for (const auto& emitter : d.emitters)
    if (!std::holds_alternative<metrofarm::scene::AreaEmitter>(emitter.model))
      add(emitter, emitter.where);
}

// Where there are not steps enough to follow a motion.
void add_motion_warnings(const transport::Scene& scene, std::vector<Error>& warnings) {
  constexpr double kSeen = 0.01;
  const geometry::Placements& placements = scene.placements();
  for (size_t i = 0; i < placements.count(); ++i) {
    if (!placements.moves(i) || placements.deviation(i) <= kSeen) continue;
    const geometry::InstanceRecord& record = scene.primitives().instances[i];
    const metrofarm::scene::SceneDescription& d = scene.description();
    const auto percent = static_cast<int>(std::min(std::ceil(100 * placements.deviation(i)), 1e6));
    warnings.push_back({"while the shutter is open this moves more than " +
                            std::to_string(placements.step_count(i)) +
                            " steps can follow: it is up to " + std::to_string(percent) +
                            " % of its size from where it should be; open the shutter for less",
                        record.shape != metrofarm::scene::kNone
                            ? d.shapes[record.shape].where
                            : d.instances[record.instance].where});
  }
}

void list_warnings(const std::vector<Error>& warnings, SceneReport& report) {
  const size_t listed = std::min(warnings.size(), kWarningsListed);
  for (size_t i = 0; i < listed; ++i) report.add_warnings(warnings[i].to_string());
  if (warnings.size() == listed) return;
  report.add_warnings("and " + std::to_string(warnings.size() - listed) + " more warnings");
}

void count_elements(const metrofarm::scene::SceneDescription& d, SceneReport& report) {
  for (const auto& shape : d.shapes) ++(*report.mutable_shapes())[kind_of(shape)];
  for (const auto& texture : d.textures) ++(*report.mutable_textures())[kind_of(texture)];
  for (const auto& bsdf : d.bsdfs) ++(*report.mutable_bsdfs())[kind_of(bsdf)];
  for (const auto& emitter : d.emitters) ++(*report.mutable_emitters())[kind_of(emitter)];
  report.set_instances(d.instances.size());
}

void fill_memory(const transport::Scene& scene, SceneReport& report) {
  const transport::SceneBytes bytes = scene.bytes();
  auto& memory = *report.mutable_memory();
  memory.set_geometry(bytes.geometry);
  memory.set_acceleration(bytes.acceleration);
  memory.set_images(bytes.images);
  memory.set_lights(bytes.lights);
  report.set_memory_bytes(bytes.total());
}

}  // namespace

SceneReport to_report(const transport::Scene& scene, const LoadTimes& times) {
  const metrofarm::scene::SceneDescription& d = scene.description();
  SceneReport report;
  report.set_width(d.film.image_width());
  report.set_height(d.film.image_height());
  report.set_filter(filter_of(d.film.filter));
  report.set_filter_radius(d.film.filter_radius);
  report.set_sensor(metrofarm::scene::kind_of(d.sensor.projection));
  report.set_max_depth(d.integrator.max_depth);
  report.set_rr_depth(d.integrator.rr_depth);
  report.set_sample_count(d.integrator.sample_count);
  report.set_integrator(d.integrator.type);
  report.set_triangles(scene.primitives().triangle_count);
  report.set_analytic_shapes(scene.primitives().analytic_kind.size());
  count_elements(d, report);
  list_lights(d, report);
  fill_memory(scene, report);
  *report.mutable_structure() = structure_of(d);
  report.set_shutter_open(d.sensor.shutter_open);
  report.set_shutter_close(d.sensor.shutter_close);
  report.set_load_seconds(times.load_seconds);
  report.set_build_seconds(times.build_seconds);
  std::vector<Error> warnings = d.warnings;
  add_motion_warnings(scene, warnings);
  list_warnings(warnings, report);
  return report;
}

namespace {

using RepeatedCounts = google::protobuf::RepeatedField<uint64_t>;

// Zeros at the end are left out.
void fill_shares(const work_unit::Shares& shares, RepeatedCounts& proposed,
                 RepeatedCounts& accepted) {
  size_t used = shares.proposed.size();
  while (used > 0 && shares.proposed[used - 1] == 0) --used;
  for (size_t i = 0; i < used; ++i) {
    proposed.Add(shares.proposed[i]);
    accepted.Add(shares.accepted[i]);
  }
}

}  // namespace

void fill_counts(const work_unit::SegmentOutput& output, farm::v1::SegmentCounts& counts) {
  const work_unit::Counts& c = output.counts;
  counts.set_mutations(c.mutations);
  counts.set_path_evaluations(c.path_evaluations);
  counts.set_rays(c.rays);
  counts.set_large_steps(c.large_steps);
  counts.set_large_accepted(c.large_accepted);
  counts.set_small_steps(c.small_steps);
  counts.set_small_accepted(c.small_accepted);
  counts.set_subpath_steps(c.subpath_steps);
  counts.set_subpath_accepted(c.subpath_accepted);
  counts.set_second_stages(c.second_stages);
  counts.set_second_accepted(c.second_accepted);
  counts.set_second_after_large(c.second_after_large);
  counts.set_second_after_large_accepted(c.second_after_large_accepted);
  counts.set_coordinates(c.coordinates);
  fill_shares(c.lengths, *counts.mutable_proposed_by_length(),
              *counts.mutable_accepted_by_length());
  fill_shares(c.techniques, *counts.mutable_proposed_by_technique(),
              *counts.mutable_accepted_by_technique());
  counts.set_longest_stay(c.stays.longest);
  counts.set_chains_trapped(c.stays.trapped);
  counts.set_chains_freed(c.stays.freed);
  for (uint64_t n : output.anomalies.counts()) counts.add_anomalies(n);
}

void fill_anomaly(const diagnostics::Anomaly& anomaly, farm::v1::Anomaly& out) {
  out.set_kind(static_cast<farm::v1::AnomalyKind>(anomaly.incident.kind));
  out.set_place(diagnostics::name_of(anomaly.incident.place));
  out.set_depth(anomaly.incident.depth);
  for (uint32_t word : anomaly.primary_sample) out.add_primary_sample(word);
}

}  // namespace metrofarm::rpc
