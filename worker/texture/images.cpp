#include "texture/images.h"

#include <bit>

#include "base/check.h"
#include "spectrum/srgb.h"

namespace metrofarm::texture {
namespace {

constexpr int kByteValues = 256;

// Linear light of bytes that stand for value / 255, then of sRGB-encoded bytes.
std::vector<float> decode_tables() {
  std::vector<float> table(2 * size_t{kByteValues});
  for (int i = 0; i < kByteValues; ++i) {
    table[i] = static_cast<float>(i / 255.0);
    table[kByteValues + i] = static_cast<float>(srgb_to_linear(i / 255.0));
  }
  return table;
}

}  // namespace

Images::Images(std::vector<scene::Image>&& images)
    : images_(std::move(images)), decode_(decode_tables()) {
  records_.reserve(images_.size());
  for (const scene::Image& image : images_) {
    METROFARM_CHECK(image.width > 0 && image.height > 0);
    METROFARM_CHECK(image.channels == 1 || image.channels == 3 || image.channels == 4);
    const bool grey = image.channels == 1;
    Record record{.row = static_cast<size_t>(image.width) * image.channels,
                  .channels = image.channels,
                  .green = grey ? 0 : 1,
                  .blue = grey ? 0 : 2};
    const size_t values = record.row * image.height;
    if (const auto* bytes = std::get_if<std::vector<uint8_t>>(&image.pixels)) {
      METROFARM_CHECK(bytes->size() == values);
      record.bytes = bytes->data();
      record.decode = decode_.data() + (image.srgb ? kByteValues : 0);
    } else {
      const auto& floats = std::get<std::vector<float>>(image.pixels);
      METROFARM_CHECK(floats.size() == values);
      record.floats = floats.data();
    }
    records_.push_back(record);
  }
}

int Images::width(scene::Index image) const {
  return images_[image].width;
}

int Images::height(scene::Index image) const {
  return images_[image].height;
}

scene::Rgb Images::Record::at(int x, int y) const {
  const size_t first = y * row + static_cast<size_t>(x) * channels;
  if (bytes != nullptr) {
    const uint8_t* p = bytes + first;
    return {decode[p[0]], decode[p[green]], decode[p[blue]]};
  }
  const float* p = floats + first;
  return {p[0], p[green], p[blue]};
}

// Lane by lane: images lie at unrelated 64-bit addresses and a pixel's three values side by side,
// so that vector gathers would load no fewer cache lines.
Spectrum Images::pixel(Int image, Int x, Int y, Mask lanes) const {
  alignas(32) int32_t images[kLanes], xs[kLanes], ys[kLanes];
  alignas(32) float r[kLanes] = {}, g[kLanes] = {}, b[kLanes] = {};
  image.store_aligned(images);
  x.store_aligned(xs);
  y.store_aligned(ys);
  for (uint32_t left = bits(lanes); left != 0; left &= left - 1) {
    const int lane = std::countr_zero(left);
    const scene::Rgb rgb = records_[images[lane]].at(xs[lane], ys[lane]);
    r[lane] = rgb[0];
    g[lane] = rgb[1];
    b[lane] = rgb[2];
  }
  return {Float::load_aligned(r), Float::load_aligned(g), Float::load_aligned(b)};
}

scene::Rgb Images::pixel(scene::Index image, int x, int y) const {
  return records_[image].at(x, y);
}

uint64_t Images::bytes() const {
  uint64_t sum = decode_.size() * sizeof(float) + records_.size() * sizeof(Record);
  for (const scene::Image& image : images_)
    std::visit([&](const auto& p) { sum += p.capacity() * sizeof(p[0]); }, image.pixels);
  return sum;
}

}  // namespace metrofarm::texture
