#include "work_unit/group_state.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <tuple>
#include <type_traits>

namespace metrofarm::work_unit {
namespace {

constexpr uint32_t kMagic = 0x34534743;  // "CGS4"

class Writer {
 public:
  template <class T>
  void put(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    const size_t at = out_.size();
    out_.resize(at + sizeof value);
    std::memcpy(&out_[at], &value, sizeof value);
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_;
};

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  template <class T>
  T get() {
    T value{};
    if (bytes_.size() < sizeof value) {
      complete_ = false;
      return value;
    }
    std::memcpy(&value, bytes_.data(), sizeof value);
    bytes_.remove_prefix(sizeof value);
    return value;
  }
  bool complete() const { return complete_; }
  bool at_end() const { return complete_ && bytes_.empty(); }

 private:
  std::string_view bytes_;
  bool complete_ = true;
};

void write_pack(Writer& w, const PackState& pack) {
  for (uint8_t member : pack.members) w.put(member);
  w.put(pack.chains.iteration);
  w.put(pack.chains.serial);
  for (int lane = 0; lane < kLanes; ++lane) {
    const metropolis::LargeStepSums& sums = pack.chains.sums[lane];
    w.put(pack.chains.f[lane]);
    w.put(sums.count);
    w.put(sums.sum);
    w.put(sums.sum_squares);
    w.put(pack.chains.stays[lane]);
    w.put(pack.payload[lane].light_vertices);
    w.put(static_cast<uint32_t>(pack.payload[lane].splats.size()));
    for (const RenderTarget::LaneSplat& p : pack.payload[lane].splats)
      for (float v : {p.x, p.y, p.rgb[0], p.rgb[1], p.rgb[2]}) w.put(v);
    w.put(static_cast<uint32_t>(pack.pairs[lane].size()));
    for (const primary_space::StoredPair& pair : pack.pairs[lane]) {
      w.put(static_cast<uint32_t>(pair.slot));
      w.put(pair.first);
      w.put(pair.second);
    }
  }
}

bool read_pairs(Reader& r, std::vector<primary_space::StoredPair>& pairs) {
  const auto count = r.get<uint32_t>();
  if (count > static_cast<uint32_t>(primary_space::kSlotCount)) return false;
  for (uint32_t i = 0; i < count && r.complete(); ++i) {
    const auto slot = r.get<uint32_t>();
    if (slot >= static_cast<uint32_t>(primary_space::kSlotCount)) return false;
    const auto first = r.get<uint32_t>();
    const auto second = r.get<uint32_t>();
    pairs.push_back({static_cast<primary_space::Slot>(slot), first, second});
  }
  return r.complete();
}

bool read_payload(Reader& r, RenderTarget::Payload& payload) {
  payload.light_vertices = r.get<int32_t>();
  const auto count = r.get<uint32_t>();
  if (payload.light_vertices < 0 || count > static_cast<uint32_t>(primary_space::kLongestPath))
    return false;
  for (uint32_t i = 0; i < count && r.complete(); ++i) {
    RenderTarget::LaneSplat p;
    for (float* v : {&p.x, &p.y, &p.rgb[0], &p.rgb[1], &p.rgb[2]}) *v = r.get<float>();
    bool sound = std::isfinite(p.x) && std::isfinite(p.y);
    for (float v : p.rgb) sound = sound && v >= 0 && std::isfinite(v);
    if (!sound) return false;
    payload.splats.push_back(p);
  }
  return r.complete();
}

bool read_lane(Reader& r, PackState& pack, int lane) {
  metropolis::LargeStepSums& sums = pack.chains.sums[lane];
  pack.chains.f[lane] = r.get<float>();
  sums.count = r.get<uint64_t>();
  sums.sum = r.get<double>();
  sums.sum_squares = r.get<double>();
  pack.chains.stays[lane] = r.get<int32_t>();
  if (pack.chains.stays[lane] < 0) return false;
  const float f = pack.chains.f[lane];
  return r.complete() && f > 0 && std::isfinite(f) && read_payload(r, pack.payload[lane]) &&
         read_pairs(r, pack.pairs[lane]);
}

}  // namespace

namespace {

// A chain outside of any pack.
struct Loose {
  int light = 0, eye = 0;  // pairs that each subpath has read
  uint8_t member = 0;
  float f = 0;
  metropolis::LargeStepSums sums;
  int32_t stay = 0;
  RenderTarget::Payload payload;
  std::vector<primary_space::StoredPair> pairs;
};

Loose take(PackState& pack, int lane) {
  Loose chain{0,
              0,
              pack.members[lane],
              pack.chains.f[lane],
              pack.chains.sums[lane],
              pack.chains.stays[lane],
              std::move(pack.payload[lane]),
              std::move(pack.pairs[lane])};
  for (const primary_space::StoredPair& pair : chain.pairs) {
    const primary_space::Stream stream = primary_space::stream_of(pair.slot);
    chain.light += stream == primary_space::Stream::kLight;
    chain.eye += stream == primary_space::Stream::kEye;
  }
  return chain;
}

void put(Loose&& chain, PackState& pack, int lane) {
  pack.members[lane] = chain.member;
  pack.chains.f[lane] = chain.f;
  pack.chains.sums[lane] = chain.sums;
  pack.chains.stays[lane] = chain.stay;
  pack.payload[lane] = std::move(chain.payload);
  pack.pairs[lane] = std::move(chain.pairs);
}

}  // namespace

void deal(GroupState& state) {
  std::vector<Loose> chains;
  chains.reserve(kGroupSize);
  for (PackState& pack : state)
    for (int lane = 0; lane < kLanes; ++lane) chains.push_back(take(pack, lane));
  std::sort(chains.begin(), chains.end(), [](const Loose& a, const Loose& b) {
    return std::tie(a.light, a.eye, a.member) < std::tie(b.light, b.eye, b.member);
  });
  for (int i = 0; i < kGroupSize; ++i) put(std::move(chains[i]), state[i / kLanes], i % kLanes);
}

std::vector<metropolis::LargeStepSums> large_step_sums(const GroupState& state) {
  std::vector<metropolis::LargeStepSums> sums(kGroupSize);
  for (const PackState& pack : state)
    for (int lane = 0; lane < kLanes; ++lane) sums[pack.members[lane]] = pack.chains.sums[lane];
  return sums;
}

std::string serialize(const GroupState& state) {
  Writer w;
  w.put(kMagic);
  for (const PackState& pack : state) write_pack(w, pack);
  return w.take();
}

Result<GroupState> parse_group_state(std::string_view bytes) {
  const Error malformed{"chain state is malformed or of another version"};
  Reader r(bytes);
  GroupState state;
  if (r.get<uint32_t>() != kMagic) return malformed;
  uint64_t met = 0;  // a bit for each chain
  for (PackState& pack : state) {
    for (uint8_t& member : pack.members) {
      member = r.get<uint8_t>();
      if (member < kGroupSize) met |= uint64_t{1} << member;
    }
    pack.chains.iteration = r.get<uint64_t>();
    pack.chains.serial = r.get<uint64_t>();
    if (pack.chains.iteration != state[0].chains.iteration) return malformed;
    for (int lane = 0; lane < kLanes; ++lane)
      if (!read_lane(r, pack, lane)) return malformed;
  }
  static_assert(kGroupSize == 64);
  if (!r.at_end() || met != ~uint64_t{0}) return malformed;
  return state;
}

}  // namespace metrofarm::work_unit
