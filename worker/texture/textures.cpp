#include "texture/textures.h"

#include <algorithm>
#include <bit>

#include "base/check.h"

namespace metrofarm::texture {
namespace {

constexpr int kMatrixStride = 6;
constexpr int kBitmapStride = 5;
enum BitmapField { kImage, kFilter, kWrap, kWidth, kHeight };

Mask valid(Int index) {
  return less(Int(scene::kNone), index);
}

Float fraction(Float x) {
  return x - xsimd::floor(x);
}

Spectrum lerp(const Spectrum& a, const Spectrum& b, Float weight) {
  // Exact where both are equal: an opacity of 1 all over stays 1.
  return a + (b - a) * weight;
}

// The weights add up to 1 but for rounding; grey is exact.
Float exact_luminance(const Spectrum& s) {
  const Mask grey = (s.x == s.y) & (s.y == s.z);
  return select(grey, s.x, metrofarm::luminance(s));
}

}  // namespace

Textures::Textures(const std::vector<scene::Texture>& textures, const Images& images,
                   const geometry::Primitives& primitives)
    : images_(&images), primitives_(&primitives) {
  for (const scene::Texture& texture : textures)
    std::visit([this](const auto& model) { add(model); }, texture.model);
  side_colour_.resize(side_colour_.size() + geometry::kSpareFloats);
}

// Fills every table with what textures of other kinds have there.
void Textures::append(Kind kind, const scene::UvMatrix& to_uv) {
  kind_.push_back(static_cast<int32_t>(kind));
  to_uv_.insert(to_uv_.end(), to_uv.begin(), to_uv.end());
  bitmap_.resize(bitmap_.size() + kBitmapStride);
  table_.push_back(scene::kNone);
  side_colour_.resize(side_colour_.size() + 6);
  side_texture_.resize(side_texture_.size() + 2, scene::kNone);
}

void Textures::add(const scene::BitmapTexture& bitmap) {
  const auto& m = bitmap.to_uv;
  // In double, so that an importer's own 1 - v cancels exactly.
  append(Kind::kBitmap, {m[0], m[1], m[2], -m[3], -m[4], static_cast<float>(1.0 - m[5])});
  const std::array<int32_t, kBitmapStride> fields = {
      bitmap.image, static_cast<int32_t>(bitmap.filter), static_cast<int32_t>(bitmap.wrap),
      images_->width(bitmap.image), images_->height(bitmap.image)};
  std::copy(fields.begin(), fields.end(), bitmap_.end() - kBitmapStride);
}

void Textures::add(const scene::CheckerboardTexture& checkerboard) {
  const auto self = static_cast<scene::Index>(kind_.size());
  append(Kind::kCheckerboard, checkerboard.to_uv);
  has_checkerboards_ = true;
  const std::array<const scene::Colour*, 2> sides = {&checkerboard.colour0, &checkerboard.colour1};
  for (size_t side = 0; side < 2; ++side) {
    // Otherwise resolve() might not end.
    METROFARM_CHECK(sides[side]->texture < self);
    std::copy_n(sides[side]->value.begin(), 3,
                side_colour_.end() - 6 + static_cast<ptrdiff_t>(3 * side));
    side_texture_[2 * static_cast<size_t>(self) + side] = sides[side]->texture;
  }
}

void Textures::add(const scene::AttributeTexture& attribute) {
  append(Kind::kAttribute, scene::kIdentityUv);
  const auto& tables = primitives_->attributes;
  const auto found = std::find_if(tables.begin(), tables.end(),
                                  [&](const auto& table) { return table.name == attribute.name; });
  if (found != tables.end()) table_.back() = static_cast<int32_t>(found - tables.begin());
}

Mask Textures::is(Kind kind, Int texture, Mask lanes) const {
  return lanes & equal(gather(kind_.data(), texture, lanes), kind);
}

Vec2 Textures::transform(Int texture, const Vec2& uv, Mask lanes) const {
  const Int first = texture * Int(kMatrixStride);
  const auto m = [&](int i) { return gather(to_uv_.data() + i, first, lanes); };
  return {m(0) * uv.x + m(1) * uv.y + m(2), m(3) * uv.x + m(4) * uv.y + m(5)};
}

Textures::Leaf Textures::resolve(Int texture, const Vec2& uv, Mask lanes) const {
  Leaf leaf{texture, splat(1.F)};
  if (!has_checkerboards_) return leaf;
  for (Mask open = is(Kind::kCheckerboard, texture, lanes); any(open);
       open = is(Kind::kCheckerboard, leaf.texture, open & valid(leaf.texture))) {
    const Vec2 at = transform(leaf.texture, uv, open);
    const Mask right = fraction(at.x) > Float(0.5F);
    const Mask upper = fraction(at.y) > Float(0.5F);
    const Int side = select(right ^ upper, Int(1), Int(0));
    const Int entry = Int(2) * leaf.texture + side;
    leaf.factor =
        select(open, leaf.factor * gather3(side_colour_.data(), entry, open), leaf.factor);
    leaf.texture = select(open, gather(side_texture_.data(), entry, open), leaf.texture);
  }
  return leaf;
}

Textures::Footprint Textures::footprint(Int texture, const Vec2& uv, Mask lanes) const {
  const Int first = texture * Int(kBitmapStride);
  const auto field = [&](BitmapField i) { return gather(bitmap_.data() + i, first, lanes); };
  const Int wrap = field(kWrap);
  const Mask bilinear = equal(field(kFilter), scene::TextureFilter::kBilinear);
  const Vec2 at = transform(texture, uv, lanes);
  return {field(kImage), locate(at.x, field(kWidth), wrap, bilinear),
          locate(at.y, field(kHeight), wrap, bilinear), bilinear};
}

Textures::Corners Textures::corners(const Footprint& at, Mask lanes) const {
  return {images_->pixel(at.image, at.x.first, at.y.first, lanes),
          images_->pixel(at.image, at.x.second, at.y.first, lanes),
          images_->pixel(at.image, at.x.first, at.y.second, lanes),
          images_->pixel(at.image, at.x.second, at.y.second, lanes)};
}

Spectrum Textures::bitmap_colour(Int texture, const Vec2& uv, Mask lanes) const {
  const Footprint at = footprint(texture, uv, lanes);
  const Mask nearest = lanes & !at.bilinear;
  Spectrum colour = splat(0.F);
  if (any(nearest)) colour = images_->pixel(at.image, at.x.first, at.y.first, nearest);
  const Mask bilinear = lanes & at.bilinear;
  if (none(bilinear)) return colour;
  const Corners c = corners(at, bilinear);
  const Spectrum mixed = lerp(lerp(c.upper_first, c.upper_second, at.x.weight),
                              lerp(c.lower_first, c.lower_second, at.x.weight), at.y.weight);
  return select(bilinear, mixed, colour);
}

Spectrum Textures::table_colour(const geometry::AttributeTable& table,
                                const geometry::SurfacePoint& point, Mask lanes) const {
  const auto value = [&](Int element) -> Spectrum {
    if (table.channels == 3) return gather3(table.values.data(), element, lanes);
    const Float grey = gather(table.values.data(), element, lanes);
    return {grey, grey, grey};
  };
  if (table.per_face) return value(point.primitive);
  const Int first = point.primitive * Int(3);
  const auto corner = [&](int i) {
    return value(gather(primitives_->indices.data() + i, first, lanes));
  };
  const Spectrum a = corner(0);
  return a + (corner(1) - a) * point.b1 + (corner(2) - a) * point.b2;
}

Spectrum Textures::attribute_colour(Int texture, const geometry::SurfacePoint& point,
                                    Mask lanes) const {
  const Int table = gather(table_.data(), texture, lanes);
  Spectrum colour = splat(0.F);
  Mask left = lanes & valid(table) & less(point.primitive, Int(primitives_->triangle_count));
  while (any(left)) {
    const auto lane = std::countr_zero(bits(left));
    const auto index = static_cast<int32_t>(lane_word(as_uint(table), lane));
    const Mask same = left & equal(table, Int(index));
    colour = select(same, table_colour(primitives_->attributes[index], point, same), colour);
    left = left & !same;
  }
  return colour;
}

Spectrum Textures::colour(Int texture, const geometry::SurfacePoint& point, Mask lanes) const {
  const Leaf leaf = resolve(texture, point.uv, lanes);
  const Mask textured = lanes & valid(leaf.texture);
  const Mask bitmap = is(Kind::kBitmap, leaf.texture, textured);
  const Mask attribute = is(Kind::kAttribute, leaf.texture, textured);
  Spectrum value = splat(1.F);
  if (any(bitmap)) value = select(bitmap, bitmap_colour(leaf.texture, point.uv, bitmap), value);
  if (any(attribute))
    value = select(attribute, attribute_colour(leaf.texture, point, attribute), value);
  return keep(lanes, value * leaf.factor);
}

Float Textures::luminance(Int texture, const geometry::SurfacePoint& point, Mask lanes) const {
  return exact_luminance(colour(texture, point, lanes));
}

Gradient Textures::gradient(Int texture, const geometry::SurfacePoint& point, Mask lanes) const {
  const Leaf leaf = resolve(texture, point.uv, lanes);
  const Mask textured = lanes & valid(leaf.texture);
  Mask smooth = is(Kind::kBitmap, leaf.texture, textured);
  if (none(smooth)) return {Float(0.F), Float(0.F)};
  const Footprint at = footprint(leaf.texture, point.uv, smooth);
  smooth = smooth & at.bilinear;
  const Corners c = corners(at, smooth);
  const auto value = [&](const Spectrum& s) { return exact_luminance(s * leaf.factor); };
  const Float across_upper = value(c.upper_second) - value(c.upper_first);
  const Float across_lower = value(c.lower_second) - value(c.lower_first);
  const Float down_first = value(c.lower_first) - value(c.upper_first);
  const Float down_second = value(c.lower_second) - value(c.upper_second);
  const Float per_pixel_x = across_upper + (across_lower - across_upper) * at.y.weight;
  const Float per_pixel_y = down_first + (down_second - down_first) * at.x.weight;
  // By the chain rule through the wrap mode, the size in pixels and the uv matrix.
  const Int size = leaf.texture * Int(kBitmapStride);
  const auto per_unit = [&](Float per_pixel, BitmapField field, Mask mirrored) {
    const Float pixels = to_float(gather(bitmap_.data() + field, size, smooth));
    return per_pixel * select(mirrored, -pixels, pixels);
  };
  const Float x = per_unit(per_pixel_x, kWidth, at.x.mirrored);
  const Float y = per_unit(per_pixel_y, kHeight, at.y.mirrored);
  const Int first = leaf.texture * Int(kMatrixStride);
  const auto m = [&](int i) { return gather(to_uv_.data() + i, first, smooth); };
  return {keep(smooth, m(0) * x + m(3) * y), keep(smooth, m(1) * x + m(4) * y)};
}

uint64_t Textures::bytes() const {
  const auto size = [](const auto& table) { return table.capacity() * sizeof(table[0]); };
  return size(kind_) + size(to_uv_) + size(bitmap_) + size(table_) + size(side_colour_) +
         size(side_texture_);
}

}  // namespace metrofarm::texture
