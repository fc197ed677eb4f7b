// Any bytes as an image file: pixels that fit the size, or an error with a message.
#include <cstddef>
#include <cstdint>

#include "base/check.h"
#include "image_io/read_image.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace metrofarm;
  constexpr uint64_t kBytes = 1 << 20;
  const auto image = image_io::read_image({data, size}, "input", image_io::Encoding::kSrgb, kBytes);
  if (!image) {
    METROFARM_CHECK(!image.error().message.empty());
    return 0;
  }
  const scene::Image& i = image.value();
  const size_t values = static_cast<size_t>(i.width) * i.height * i.channels;
  METROFARM_CHECK(std::visit([](const auto& p) { return p.size(); }, i.pixels) == values);
  METROFARM_CHECK(i.channels == 1 || i.channels == 3 || i.channels == 4);
  return 0;
}
