// The facts of a scene that decide which features a job needs.
#pragma once

#include "metrofarm/scene/v1/scene.pb.h"
#include "scene/description.h"

namespace metrofarm::rpc {

metrofarm::scene::v1::Structure structure_of(const metrofarm::scene::SceneDescription& scene);

}  // namespace metrofarm::rpc
