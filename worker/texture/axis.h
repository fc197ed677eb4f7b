// Which pixels of an image a texture coordinate falls between, along one axis.
#pragma once

#include "math/lanes.h"
#include "scene/description.h"

namespace metrofarm::texture {

// Two neighbours and the second one's weight.
struct Axis {
  Int first, second;
  Float weight;
  Mask mirrored;  // the wrap mode mirrors the image here
};

// coordinate: 0 .. 1 across the image of `size` pixels, whose centers lie at (i + 0.5) / size; any
// value. wrap: a scene::TextureWrap per lane. Where not `bilinear`, `first` is the pixel that the
// coordinate lies in. Indices are inside the image whatever the coordinate is; of NaN the weight is
// NaN.
Axis locate(Float coordinate, Int size, Int wrap, Mask bilinear);

}  // namespace metrofarm::texture
