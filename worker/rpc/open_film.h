// A film that segments of one round are collected in until it is delivered.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "diagnostics/anomalies.h"
#include "film/film.h"
#include "rpc/batch.h"

namespace metrofarm::rpc {

// Where a film goes.
struct Receiver {
  const void* coordinator = nullptr;  // only compared
  // Takes the sealed film; may block.
  std::function<void(Batch)> deliver;
  // Takes the leases of a film that came to nothing.
  std::function<void(const std::vector<farm::v1::LeaseRef>&)> give_back;
};

class OpenFilm {
 public:
  // A film's largest splat is under 2^4 units of 2^32 steps; so many mutations stay below 2^62.
  static constexpr uint64_t kMutations = uint64_t{1} << 26;

  OpenFilm(const film::FilmShape& shape, const std::string& job, uint32_t round, Receiver receiver);

  // Whether segments that are leased by this coordinator go into this film.
  bool is_for(const film::FilmShape& shape, const std::string& job, uint32_t round,
              const void* coordinator) const;
  // Makes room for the splats of so many mutations; false: values might overflow. Requires: nobody
  // splats meanwhile. What is in the film counts for what it is and not for the worst that it could
  // be, so that the film may stay open for long.
  bool reserve(uint64_t mutations);
  film::Film& film() { return film_; }

  // Part of a segment is in the film that nobody will finish, and cannot be taken out: the film can
  // only be discarded, and segments under way may end. From any thread.
  void spoil() { spoiled_.request_stop(); }
  std::stop_token spoiled() const { return spoiled_.get_token(); }

  // A segment that was rendered into the film, and what else it leaves.
  farm::v1::SegmentResult& add_segment(double cpu_seconds);
  void add_anomalies(const diagnostics::AnomalyLog& anomalies) { anomalies_.merge(anomalies); }

  // Whether it should be delivered: it is as old as it should become, or will be nearer to that now
  // than after another lease like the last one; or its header has become long.
  bool due(double seal_seconds, double lease_seconds) const;
  // Delivers what is there, or gives it back where memory runs out. Requires: it is not spoiled.
  void seal(int threads);
  // Gives all leases back: parts of other segments are in the film.
  void discard();

 private:
  film::Film film_;
  std::stop_source spoiled_;
  Receiver receiver_;
  farm::v1::BatchHeader header_;
  diagnostics::AnomalyLog anomalies_;
  uint64_t mutations_ = 0;   // that the values could be of, at worst
  size_t header_bytes_ = 0;  // about
  std::chrono::steady_clock::time_point opened_ = std::chrono::steady_clock::now();
};

}  // namespace metrofarm::rpc
