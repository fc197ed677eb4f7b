#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfIntAttribute.h>
#include <ImfOutputFile.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <half.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "shim.h"
#include "shim_error.h"

namespace {

// A file in memory. OpenEXR seeks back once to fill in the line offset table.
class MemoryStream final : public Imf::OStream {
 public:
  MemoryStream() : Imf::OStream("memory") {}

  void write(const char bytes[], int count) override {
    const size_t end = position_ + static_cast<size_t>(count);
    if (end > bytes_.size()) bytes_.resize(end);
    std::copy_n(bytes, count, bytes_.begin() + static_cast<std::ptrdiff_t>(position_));
    position_ = end;
  }
  uint64_t tellp() override { return position_; }
  void seekp(uint64_t position) override { position_ = position; }

  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  size_t position_ = 0;
};

constexpr const char* kColors[] = {"R", "G", "B"};

// An overflow to infinity would spoil every filter that touches the pixel.
half to_half(float value) {
  const float limit = std::numeric_limits<half>::max();
  return half(std::clamp(value, -limit, limit));
}

// One of three interleaved channels.
template <typename T>
void add_channel(Imf::Header& header, Imf::FrameBuffer& frame, const char* name, const T* values,
                 Imf::PixelType type) {
  const auto width = static_cast<size_t>(header.dataWindow().max.x) + 1;
  header.channels().insert(name, Imf::Channel(type));
  // The library takes a mutable pointer for reading and writing alike; writing a file only reads.
  auto* base = reinterpret_cast<char*>(const_cast<T*>(values));
  frame.insert(name, Imf::Slice(type, base, 3 * sizeof(T), 3 * sizeof(T) * width));
}

}  // namespace

struct mf_exr_writer {
  mf_exr_writer(int width, int height) : header(width, height) {
    header.compression() = Imf::ZIP_COMPRESSION;
    Imf::addChromaticities(header, Imf::Chromaticities());  // the default is Rec. 709
  }

  void encode(const float* rgb, bool as_half) {
    const int height = header.dataWindow().max.y + 1;
    const auto count =
        3 * (static_cast<size_t>(header.dataWindow().max.x) + 1) * static_cast<size_t>(height);
    std::vector<half> halves;
    if (as_half) {
      halves.resize(count);
      std::transform(rgb, rgb + count, halves.begin(), to_half);
    }
    for (int c = 0; c < 3; ++c) {
      if (as_half) {
        add_channel(header, frame, kColors[c], halves.data() + c, Imf::HALF);
      } else {
        add_channel(header, frame, kColors[c], rgb + c, Imf::FLOAT);
      }
    }
    Imf::OutputFile file(stream, header);
    file.setFrameBuffer(frame);
    file.writePixels(height);
  }

  Imf::Header header;
  Imf::FrameBuffer frame;
  MemoryStream stream;
};

using metrofarm::guarded;

char* mf_exr_writer_new(int width, int height, mf_exr_writer** out) {
  return guarded([&] { *out = new mf_exr_writer(width, height); });
}

void mf_exr_writer_free(mf_exr_writer* writer) {
  delete writer;
}

char* mf_exr_set_string(mf_exr_writer* writer, const char* name, const char* value) {
  return guarded([&] { writer->header.insert(name, Imf::StringAttribute(value)); });
}

char* mf_exr_set_int(mf_exr_writer* writer, const char* name, int value) {
  return guarded([&] { writer->header.insert(name, Imf::IntAttribute(value)); });
}

char* mf_exr_set_float(mf_exr_writer* writer, const char* name, float value) {
  return guarded([&] { writer->header.insert(name, Imf::FloatAttribute(value)); });
}

char* mf_exr_add_channel(mf_exr_writer* writer, const char* name, const float* values) {
  return guarded([&] { add_channel(writer->header, writer->frame, name, values, Imf::FLOAT); });
}

char* mf_exr_encode(mf_exr_writer* writer, const float* rgb, int as_half, const char** bytes,
                    size_t* size) {
  return guarded([&] {
    writer->encode(rgb, as_half != 0);
    *bytes = writer->stream.bytes().data();
    *size = writer->stream.bytes().size();
  });
}
