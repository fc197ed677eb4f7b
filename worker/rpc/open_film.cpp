#include "rpc/open_film.h"

#include <new>
#include <utility>

#include "rpc/convert.h"

namespace metrofarm::rpc {

namespace {

// One mutation's largest splat, in steps of the film.
constexpr uint64_t kLargestSplat = uint64_t{1} << 36;
// Of the headers that a coordinator takes, half.
constexpr size_t kLongHeader = size_t{32} << 20;

bool same(const film::FilmShape& a, const film::FilmShape& b) {
  return a.width == b.width && a.height == b.height && a.layers == b.layers;
}

}  // namespace

OpenFilm::OpenFilm(const film::FilmShape& shape, const std::string& job, uint32_t round,
                   Receiver receiver)
    : film_(shape), receiver_(std::move(receiver)) {
  header_.set_job_id(job);
  header_.set_round(round);
}

bool OpenFilm::is_for(const film::FilmShape& shape, const std::string& job, uint32_t round,
                      const void* coordinator) const {
  return same(film_.shape(), shape) && header_.job_id() == job && header_.round() == round &&
         receiver_.coordinator == coordinator;
}

bool OpenFilm::reserve(uint64_t mutations) {
  if (mutations_ + mutations >= kMutations && header_.segments_size() > 0)
    mutations_ = film_.largest_magnitude() / kLargestSplat + 1;
  if (mutations_ > 0 && mutations_ + mutations >= kMutations) return false;
  mutations_ += mutations;
  return true;
}

farm::v1::SegmentResult& OpenFilm::add_segment(double cpu_seconds) {
  if (header_.segments_size() > 0)
    header_bytes_ += header_.segments(header_.segments_size() - 1).ByteSizeLong();
  header_.set_cpu_seconds(header_.cpu_seconds() + cpu_seconds);
  return *header_.add_segments();
}

bool OpenFilm::due(double seal_seconds, double lease_seconds) const {
  const std::chrono::duration<double> age = std::chrono::steady_clock::now() - opened_;
  return age.count() + 0.5 * lease_seconds >= seal_seconds || header_bytes_ > kLongHeader;
}

void OpenFilm::seal(int threads) {
  if (header_.segments_size() == 0) return;
  try {
    for (const auto& sample : anomalies_.samples()) fill_anomaly(sample, *header_.add_anomalies());
    receiver_.deliver(rpc::seal(header_, film_, threads));
  } catch (const std::bad_alloc&) {
    discard();
  }
}

void OpenFilm::discard() {
  std::vector<farm::v1::LeaseRef> leases;
  for (const auto& segment : header_.segments()) leases.push_back(segment.lease());
  header_.clear_segments();
  receiver_.give_back(leases);
}

}  // namespace metrofarm::rpc
