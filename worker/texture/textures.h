// The textures of a scene, evaluated at eight surface points at once.
#pragma once

#include <cstdint>
#include <vector>

#include "geometry/primitives.h"
#include "geometry/surface.h"
#include "scene/description.h"
#include "spectrum/rgb.h"
#include "texture/axis.h"
#include "texture/images.h"

namespace metrofarm::texture {

// Change of a texture's luminance along the surface coordinates.
struct Gradient {
  Float du, dv;
};

// Immutable; thread-safe.
class Textures {
 public:
  // images and primitives: outlive this.
  Textures(const std::vector<scene::Texture>& textures, const Images& images,
           const geometry::Primitives& primitives);

  // `texture` indexes the description's textures and is valid in all of `lanes`; other lanes are 0.
  Spectrum colour(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  // Of a grey texture exactly its value.
  Float luminance(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  // Of the bilinear interpolation between pixels: constant along a row or column between the
  // centres of four pixels. Zero for textures that are constant in pieces (checkerboards, nearest
  // pixels) and for mesh attributes.
  Gradient gradient(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;

  uint64_t bytes() const;

 private:
  enum class Kind : int32_t { kBitmap, kCheckerboard, kAttribute };

  // Where checkerboards lead: to another texture or to none (the constant 1), times a factor.
  struct Leaf {
    Int texture;
    Spectrum factor;
  };
  struct Footprint {
    Int image;
    Axis x, y;
    Mask bilinear;  // elsewhere x.first and y.first are the pixel
  };
  // The pixels of a footprint: `first` or `second` in x, `upper` (first) or `lower` in y.
  struct Corners {
    Spectrum upper_first, upper_second, lower_first, lower_second;
  };

  void add(const scene::BitmapTexture& bitmap);
  void add(const scene::CheckerboardTexture& checkerboard);
  void add(const scene::AttributeTexture& attribute);
  void append(Kind kind, const scene::UvMatrix& to_uv);

  Mask is(Kind kind, Int texture, Mask lanes) const;
  Vec2 transform(Int texture, const Vec2& uv, Mask lanes) const;
  Leaf resolve(Int texture, const Vec2& uv, Mask lanes) const;
  Footprint footprint(Int texture, const Vec2& uv, Mask lanes) const;
  Corners corners(const Footprint& at, Mask lanes) const;
  Spectrum bitmap_colour(Int texture, const Vec2& uv, Mask lanes) const;
  Spectrum attribute_colour(Int texture, const geometry::SurfacePoint& point, Mask lanes) const;
  Spectrum table_colour(const geometry::AttributeTable& table, const geometry::SurfacePoint& point,
                        Mask lanes) const;

  const Images* images_;
  const geometry::Primitives* primitives_;
  bool has_checkerboards_ = false;

  // ---- by texture ----
  std::vector<int32_t> kind_;
  std::vector<float> to_uv_;     // 6 each; bitmaps: to (u, 1 - v), so that rows run downwards
  std::vector<int32_t> bitmap_;  // kBitmapStride each: image, filter, wrap, width, height
  std::vector<int32_t> table_;   // an attribute's table in primitives, or kNone
  // Colour and texture of a checkerboard's two sides; colours end with spare floats for gather3.
  std::vector<float> side_colour_;
  std::vector<int32_t> side_texture_;
};

}  // namespace metrofarm::texture
