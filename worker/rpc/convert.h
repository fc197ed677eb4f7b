// Between the wire and the units of work.
#pragma once

#include "base/result.h"
#include "metrofarm/farm/v1/task.pb.h"
#include "metrofarm/job/v1/spec.pb.h"
#include "transport/scene.h"
#include "work_unit/context.h"
#include "work_unit/units.h"

namespace metrofarm::rpc {

// Fails with the field that this worker cannot serve.
Result<work_unit::Spec> to_spec(const job::v1::ResolvedSpec& spec,
                                const scene::SceneDescription& scene);

Result<metropolis::Kernel> to_kernel(const job::v1::Kernel& kernel);

struct LoadTimes {
  double load_seconds = 0;
  double build_seconds = 0;
};
metrofarm::scene::v1::SceneReport to_report(const transport::Scene& scene, const LoadTimes& times);

void fill_counts(const work_unit::SegmentOutput& output, farm::v1::SegmentCounts& counts);
void fill_anomaly(const diagnostics::Anomaly& anomaly, farm::v1::Anomaly& out);

}  // namespace metrofarm::rpc
