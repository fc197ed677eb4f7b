// Scenes in which light sampling is tested, each seen from a reference point.
#pragma once

#include <string>
#include <vector>

#include "scene/description.h"
#include "tests/support/lane_tools.h"

namespace metrofarm::test {

struct LightCase {
  std::string name;
  scene::SceneDescription scene;
  Double3 reference;
  // The part of the sphere that the histogram covers: an axis and 1 - cos of the half-angle.
  Double3 axis = {0, 0, 1};
  double one_minus_cos = 2;
  // Of a light's normal against the ray. The ray that looks where a sample lies meets a curved
  // light at a slightly different place (see Surface::offset), which a grazing view magnifies; at
  // the outline it passes the light.
  double least_cosine = 0;
};

std::vector<LightCase> light_cases();

}  // namespace metrofarm::test
