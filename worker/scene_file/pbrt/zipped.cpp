#include "scene_file/pbrt/zipped.h"

#include <zlib.h>

#include <algorithm>
#include <limits>

namespace metrofarm::scene_file::pbrt {
namespace {

constexpr size_t kStep = size_t{1} << 20;

class Inflater {
 public:
  explicit Inflater(const std::string& input) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(input.data()));
    left_ = input.size();
    ready_ = inflateInit2(&stream_, 15 + 16) == Z_OK;  // 16: a gzip header
  }
  ~Inflater() {
    if (ready_) inflateEnd(&stream_);
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  // False if the data are damaged, cut short or more than max_bytes.
  bool run(uint64_t max_bytes, std::string& output) {
    int status = ready_ ? Z_OK : Z_STREAM_ERROR;
    while (status == Z_OK && output.size() <= max_bytes) {
      const size_t before = output.size();
      output.resize(before + kStep);
      if (stream_.avail_in == 0) feed();
      stream_.next_out = reinterpret_cast<Bytef*>(output.data() + before);
      stream_.avail_out = kStep;
      status = inflate(&stream_, Z_NO_FLUSH);
      output.resize(before + kStep - stream_.avail_out);
    }
    return status == Z_STREAM_END && output.size() <= max_bytes;
  }

 private:
  void feed() {
    const size_t part = std::min<size_t>(left_, std::numeric_limits<uInt>::max());
    stream_.avail_in = static_cast<uInt>(part);
    left_ -= part;
  }

  z_stream stream_{};
  size_t left_ = 0;
  bool ready_ = false;
};

}  // namespace

Result<FileBytes> unzip_if_named_gz(const std::string& name, const FileBytes& bytes,
                                    const MemoryBudget& memory) {
  if (!name.ends_with(".gz")) return bytes;
  auto plain = std::make_shared<std::string>();
  const uint64_t limit = memory.for_file(bytes->size());
  if (Inflater(*bytes).run(limit, *plain)) return FileBytes(std::move(plain));
  return Error{"\"" + name +
               "\" can't be decompressed: it is no gzip file, is damaged or holds "
               "more than " +
               std::to_string(limit) +
               " bytes, the most for a file of its size; "
               "gunzip it and name the plain file"};
}

}  // namespace metrofarm::scene_file::pbrt
