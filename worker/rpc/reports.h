// What tasks of all kinds report alike.
#pragma once

#include <string>

#include "metrofarm/farm/v1/farm_service.pb.h"
#include "work_unit/units.h"

namespace metrofarm::rpc {

double thread_cpu_seconds();

void fill_lease(const farm::v1::Task& task, farm::v1::LeaseRef& lease);
farm::v1::ReportRequest failure_report(const farm::v1::Task& task, farm::v1::FailureReason reason,
                                       const std::string& message);
work_unit::ChainSeeds seeds_of(const farm::v1::ChainGroupState& group);

}  // namespace metrofarm::rpc
