#include "scene_file/pbrt/zipped.h"

#include <zlib.h>

#include <algorithm>
#include <limits>

namespace metrofarm::scene_file::pbrt {
namespace {

constexpr size_t kMostBytes = size_t{4} << 30;
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

  // False if the data are damaged, cut short or too many.
  bool run(std::string& output) {
    int status = ready_ ? Z_OK : Z_STREAM_ERROR;
    while (status == Z_OK && output.size() < kMostBytes) {
      const size_t before = output.size();
      output.resize(before + kStep);
      if (stream_.avail_in == 0) feed();
      stream_.next_out = reinterpret_cast<Bytef*>(output.data() + before);
      stream_.avail_out = kStep;
      status = inflate(&stream_, Z_NO_FLUSH);
      output.resize(before + kStep - stream_.avail_out);
    }
    return status == Z_STREAM_END;
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

Result<FileBytes> unzip_if_named_gz(const std::string& name, const FileBytes& bytes) {
  if (!name.ends_with(".gz")) return bytes;
  auto plain = std::make_shared<std::string>();
  if (Inflater(*bytes).run(*plain)) return FileBytes(std::move(plain));
  return Error{"\"" + name +
               "\" can't be decompressed: it is no gzip file, is damaged or holds "
               "more than 4 GiB; gunzip it and name the plain file"};
}

}  // namespace metrofarm::scene_file::pbrt
