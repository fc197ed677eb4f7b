#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfIntAttribute.h>
#include <ImfStringAttribute.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "shim.h"
#include "shim_error.h"

namespace {

class MemoryStream final : public Imf::IStream {
 public:
  MemoryStream(const char* bytes, size_t size)
      : Imf::IStream("memory"), bytes_(bytes), size_(size) {}

  bool read(char target[], int count) override {
    const auto wanted = static_cast<size_t>(count);
    if (position_ > size_ || wanted > size_ - position_) {
      throw std::runtime_error("the file ends early");
    }
    std::memcpy(target, bytes_ + position_, wanted);
    position_ += wanted;
    return position_ < size_;
  }
  uint64_t tellg() override { return position_; }
  void seekg(uint64_t position) override { position_ = position; }

 private:
  const char* bytes_;
  size_t size_;
  size_t position_ = 0;
};

std::string to_text(float value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", static_cast<double>(value));
  return text;
}

}  // namespace

struct mf_exr_reader {
  mf_exr_reader(const char* bytes, size_t size) : stream(bytes, size), file(stream) {
    const auto& channels = file.header().channels();
    for (auto it = channels.begin(); it != channels.end(); ++it) {
      names.emplace_back(it.name());
      halves.push_back(it.channel().type == Imf::HALF);
    }
    for (auto it = file.header().begin(); it != file.header().end(); ++it) {
      add_attribute(it.name(), it.attribute());
    }
  }

  void add_attribute(const char* name, const Imf::Attribute& attribute) {
    if (const auto* text = dynamic_cast<const Imf::StringAttribute*>(&attribute)) {
      attributes.emplace_back(name, text->value());
    } else if (const auto* integer = dynamic_cast<const Imf::IntAttribute*>(&attribute)) {
      attributes.emplace_back(name, std::to_string(integer->value()));
    } else if (const auto* real = dynamic_cast<const Imf::FloatAttribute*>(&attribute)) {
      attributes.emplace_back(name, to_text(real->value()));
    }
  }

  int width() const {
    return file.header().dataWindow().max.x - file.header().dataWindow().min.x + 1;
  }
  int height() const {
    return file.header().dataWindow().max.y - file.header().dataWindow().min.y + 1;
  }

  void read(const char* name, float* values) {
    const auto window = file.header().dataWindow();
    if (file.header().channels().findChannel(name) == nullptr) {
      throw std::runtime_error("no such channel");
    }
    const size_t row = sizeof(float) * static_cast<size_t>(width());
    auto slice =
        Imf::Slice::Make(Imf::FLOAT, values, window.min, width(), height(), sizeof(float), row);
    Imf::FrameBuffer frame;
    frame.insert(name, slice);
    file.setFrameBuffer(frame);
    file.readPixels(window.min.y, window.max.y);
  }

  MemoryStream stream;
  Imf::InputFile file;
  std::vector<std::string> names;
  std::vector<bool> halves;
  std::vector<std::pair<std::string, std::string>> attributes;
};

using metrofarm::guarded;

char* mf_exr_reader_new(const char* bytes, size_t size, mf_exr_reader** out) {
  return guarded([&] { *out = new mf_exr_reader(bytes, size); });
}

void mf_exr_reader_free(mf_exr_reader* reader) {
  delete reader;
}

void mf_exr_size(const mf_exr_reader* reader, int* width, int* height) {
  *width = reader->width();
  *height = reader->height();
}

int mf_exr_channel_count(const mf_exr_reader* reader) {
  return static_cast<int>(reader->names.size());
}

const char* mf_exr_channel(const mf_exr_reader* reader, int index, int* half) {
  const auto i = static_cast<size_t>(index);
  *half = reader->halves[i] ? 1 : 0;
  return reader->names[i].c_str();
}

char* mf_exr_read_channel(mf_exr_reader* reader, const char* name, float* values) {
  return guarded([&] { reader->read(name, values); });
}

int mf_exr_attribute_count(const mf_exr_reader* reader) {
  return static_cast<int>(reader->attributes.size());
}

const char* mf_exr_attribute(const mf_exr_reader* reader, int index, const char** value) {
  const auto& [name, text] = reader->attributes[static_cast<size_t>(index)];
  *value = text.c_str();
  return name.c_str();
}
