#include "tests/rpc/fake_coordinator.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <thread>

#include "metrofarm/farm/v1/farm_service.grpc.pb.h"
#include "rpc/checksum.h"
#include "rpc/sha256.h"
#include "tests/support/film_values.h"
#include "tests/support/tiles.h"

namespace metrofarm::test {

using namespace std::chrono_literals;
using namespace metrofarm::farm::v1;
using Clock = std::chrono::steady_clock;
using grpc::ServerContext;
using grpc::Status;
using metrofarm::rpc::sha256_hex;

namespace {

constexpr int kSide = 64;  // of the image, as in the scene

constexpr char kScene[] = R"(<scene version="3.0.0">
  <integrator type="path"/>
  <sensor type="perspective"><float name="fov" value="70"/>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/>
      <rfilter type="box"/></film></sensor>
  <shape type="sphere"><boolean name="flip_normals" value="true"/>
    <bsdf type="diffuse"/><emitter type="area"/></shape>
</scene>)";

}  // namespace

bool eventually(const std::function<bool()>& condition) {
  const auto end = Clock::now() + 300s;
  while (!condition()) {
    if (Clock::now() > end) return false;
    std::this_thread::sleep_for(2ms);
  }
  return true;
}

class FakeCoordinator::Service final : public FarmService::Service {
 public:
  explicit Service(std::shared_ptr<grpc::ServerCredentials> credentials)
      : credentials_(credentials ? std::move(credentials) : grpc::InsecureServerCredentials()) {}

  void start() {
    closing_ = false;
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:" + std::to_string(port), credentials_, &port);
    builder.AddListeningPort("127.0.0.1:" + std::to_string(port2), credentials_, &port2);
    builder.RegisterService(this);
    builder.SetMaxReceiveMessageSize(256 << 20);
    server_ = builder.BuildAndStart();
  }

  void stop() {
    {
      const std::lock_guard lock(mutex);
      closing_ = true;
      workers_.clear();
      ++life_;
      for (const Task& task : held_) waiting_.push_back(task);
      held_.clear();
    }
    changed.notify_all();
    if (server_ == nullptr) return;
    server_->Shutdown(std::chrono::system_clock::now());
    server_.reset();
  }

  // Knows an instance again, but not after stop().
  Status Register(ServerContext* /*context*/, const RegisterRequest* in,
                  RegisterResponse* out) override {
    const std::lock_guard lock(mutex);
    ++account.registered;
    // As the real one does: the same at every coordinator, which are told apart by themselves.
    out->set_worker_id("w-" + in->instance());
    out->set_coordinator_id(std::to_string(port) + "-" + std::to_string(life_));
    out->set_heartbeat_seconds(0.1);
    workers_.insert(out->worker_id());
    return Status::OK;
  }

  Status Lease(ServerContext* context, const LeaseRequest* in, LeaseResponse* out) override {
    const auto end = Clock::now() + std::chrono::duration<double>(in->wait_seconds());
    std::unique_lock lock(mutex);
    if (!workers_.contains(in->worker_id())) return unknown();
    ++account.polls;
    ++account.waiting;
    while (!closing_ && !draining && !context->IsCancelled() &&
           (hanging || (waiting_.empty() && Clock::now() < end)))
      changed.wait_for(lock, 5ms);
    --account.waiting;
    if (closing_) return {grpc::StatusCode::UNAVAILABLE, "stopping"};
    out->set_drain(draining);
    out->set_ttl_seconds(10);
    out->set_seal_seconds(seal_seconds);
    if (draining || context->IsCancelled()) return Status::OK;
    for (uint32_t i = 0; i < in->max_segments() && !waiting_.empty(); ++i) {
      *out->add_tasks() = waiting_.front();
      held_.push_back(waiting_.front());
      waiting_.pop_front();
    }
    if (out->tasks_size() > 0) account.grants.push_back(Clock::now());
    account.granted += out->tasks_size();
    account.most_granted = std::max(account.most_granted, out->tasks_size());
    return Status::OK;
  }

  Status Heartbeat(ServerContext* /*context*/, const HeartbeatRequest* in,
                   HeartbeatResponse* out) override {
    const std::lock_guard lock(mutex);
    if (!workers_.contains(in->worker_id())) return unknown();
    out->set_drain(draining);
    account.most_renewed = std::max(account.most_renewed, in->leases_size());
    for (const LeaseProgress& progress : in->leases()) {
      LeaseDirective& directive = *out->add_directives();
      *directive.mutable_lease() = progress.lease();
      directive.set_directive(holds(progress.lease()) ? DIRECTIVE_CONTINUE : of_lost);
    }
    return Status::OK;
  }

  Status FetchBundle(ServerContext* /*context*/, const FetchBundleRequest* /*in*/,
                     grpc::ServerWriter<FetchBundleResponse>* writer) override {
    const std::lock_guard lock(mutex);
    ++account.fetched;
    FetchBundleResponse piece;
    auto& file = *piece.mutable_manifest()->add_files();
    file.set_path("scene.xml");
    file.set_size(scene.size());
    file.set_sha256(sha256_hex(scene));
    writer->Write(piece);
    piece.set_data(scene);
    writer->Write(piece);
    return Status::OK;
  }

  Status Report(ServerContext* /*context*/, const ReportRequest* in, ReportResponse* out) override {
    const std::lock_guard lock(mutex);
    if (!workers_.contains(in->worker_id())) return unknown();
    if (in->checksum() != rpc::checksum(*in)) {
      out->set_outcome(OUTCOME_CONFLICT);
      return Status::OK;
    }
    if (in->has_failure()) account.failures.push_back(in->failure());
    settle(in->lease().task_id(), false);
    out->set_outcome(OUTCOME_COMMITTED);
    return Status::OK;
  }

  Status Release(ServerContext* /*context*/, const ReleaseRequest* in,
                 ReleaseResponse* /*out*/) override {
    const std::lock_guard lock(mutex);
    if (!workers_.contains(in->worker_id())) return unknown();
    for (const LeaseRef& lease : in->leases()) {
      ++account.released;
      settle(lease.task_id(), true);
    }
    if (in->leaving()) {
      ++account.left;
      workers_.erase(in->worker_id());
      for (const Task& task : held_) waiting_.push_back(task);
      held_.clear();
    }
    changed.notify_all();
    return Status::OK;
  }

  Status Deliver(ServerContext* context, grpc::ServerReader<DeliverRequest>* reader,
                 DeliverResponse* out) override {
    DeliverRequest message;
    if (!reader->Read(&message) || !message.has_header())
      return {grpc::StatusCode::INVALID_ARGUMENT, "no header"};
    const DeliverHeader header = message.header();
    uint32_t tiles = 0;
    uint64_t digest = 0;
    film::Film batch({kSide, kSide, 1});
    while (reader->Read(&message)) {
      tiles += static_cast<uint32_t>(message.tiles().tiles_size());
      for (const Tile& tile : message.tiles().tiles()) digest += test::add_tile(tile, batch);
    }
    std::unique_lock lock(mutex);
    ++account.delivering;
    while (hanging_deliveries && !closing_ && !context->IsCancelled()) changed.wait_for(lock, 5ms);
    --account.delivering;
    if (closing_ || context->IsCancelled()) return {grpc::StatusCode::UNAVAILABLE, "stopping"};
    if (!workers_.contains(header.worker_id())) return unknown();
    const bool whole = tiles == header.batch().tile_count();
    ++account.batches;
    bool sound = digest == header.batch().digest();
    for (const SegmentResult& segment : header.batch().segments())
      sound = sound && segment.checksum() == rpc::checksum(segment);
    for (const SegmentResult& segment : header.batch().segments())
      if (settle(segment.lease().task_id(), !sound) && whole && sound) ++account.delivered;
    if (!sound) ++account.unsound;
    if (sound && whole) add(batch);
    out->set_outcome(!sound ? OUTCOME_CONFLICT : whole ? OUTCOME_COMMITTED : OUTCOME_REJECTED);
    return Status::OK;
  }

  void add_segments(int count, uint64_t samples) {
    const std::lock_guard lock(mutex);
    for (int i = 0; i < count; ++i) waiting_.push_back(make_task(samples));
    changed.notify_all();
  }

  void withdraw(uint64_t samples, Directive directive) {
    const std::lock_guard lock(mutex);
    of_lost = directive;
    std::erase_if(held_, [&](const Task& task) { return task.spec().round_sizes(0) == samples; });
  }

  int open() const { return static_cast<int>(waiting_.size()); }  // requires: mutex

  mutable std::mutex mutex;
  std::condition_variable changed;
  int port = 0, port2 = 0;
  bool draining = false, hanging = false, hanging_deliveries = false;
  double seal_seconds = 1e-9;
  Directive of_lost = DIRECTIVE_ABANDON;  // said of leases that are not held
  std::string scene = kScene;
  Account account;
  std::vector<int64_t> film;

 private:
  static Status unknown() { return {grpc::StatusCode::NOT_FOUND, "unknown worker"}; }

  bool holds(const LeaseRef& lease) const {
    return std::ranges::any_of(held_, [&](const Task& task) {
      return task.task_id() == lease.task_id() && task.epoch() == lease.epoch();
    });
  }

  void add(const film::Film& batch) {
    const std::vector<int64_t> values = test::all_values(batch);
    film.resize(values.size());
    for (size_t i = 0; i < values.size(); ++i) film[i] += values[i];
  }

  // Takes a lease off the list; false if nobody held it.
  bool settle(const std::string& task_id, bool again) {
    const auto at = std::find_if(held_.begin(), held_.end(),
                                 [&](const Task& task) { return task.task_id() == task_id; });
    if (at == held_.end()) return false;
    if (again) waiting_.push_back(*at);
    held_.erase(at);
    return true;
  }

  Task make_task(uint64_t samples) {
    Task task;
    const int number = made_++;
    task.set_task_id("job/" + std::to_string(port) + "/" + std::to_string(number));
    task.set_epoch(static_cast<uint64_t>(number) + 1);
    task.set_job_id("job");
    const std::string lines =
        sha256_hex(scene) + " " + std::to_string(scene.size()) + " scene.xml\n";
    task.mutable_scene()->set_bundle_digest(sha256_hex(lines));
    task.mutable_scene()->set_entry("scene.xml");
    auto& spec = *task.mutable_spec();
    spec.set_integrator(job::v1::INTEGRATOR_PATH);
    spec.set_light_sampling(job::v1::LIGHT_SAMPLING_MIS);
    spec.set_max_depth(3);
    spec.set_rr_depth(5);
    spec.set_width(kSide);
    spec.set_height(kSide);
    spec.set_seed(1);
    spec.set_group_size(64);
    spec.set_bootstrap_samples(128);
    spec.set_unit(1);
    spec.set_blocks_per_segment(1);
    spec.add_round_sizes(samples);
    task.mutable_paths()->set_first_segment(static_cast<uint32_t>(number % 64));
    task.mutable_paths()->set_segment_count(1);
    return task;
  }

  std::shared_ptr<grpc::ServerCredentials> credentials_;
  std::unique_ptr<grpc::Server> server_;
  bool closing_ = false;
  int made_ = 0, life_ = 0;
  std::set<std::string> workers_;
  std::deque<Task> waiting_;
  std::vector<Task> held_;
};

FakeCoordinator::FakeCoordinator(const std::shared_ptr<grpc::ServerCredentials>& credentials)
    : service_(std::make_unique<Service>(credentials)) {
  service_->start();
}

FakeCoordinator::~FakeCoordinator() {
  stop();
}

std::string FakeCoordinator::address() const {
  return "127.0.0.1:" + std::to_string(service_->port);
}

std::string FakeCoordinator::second_address() const {
  return "127.0.0.1:" + std::to_string(service_->port2);
}

void FakeCoordinator::stop() {
  service_->stop();
}

void FakeCoordinator::start() {
  service_->start();
}

void FakeCoordinator::add_segments(int count, uint64_t samples) {
  service_->add_segments(count, samples);
}

void FakeCoordinator::set_scene(const std::string& xml) {
  const std::lock_guard lock(service_->mutex);
  service_->scene = xml;
}

void FakeCoordinator::seal_every(double seconds) {
  const std::lock_guard lock(service_->mutex);
  service_->seal_seconds = seconds;
}

void FakeCoordinator::drain() {
  const std::lock_guard lock(service_->mutex);
  service_->draining = true;
}

void FakeCoordinator::hang(bool on) {
  const std::lock_guard lock(service_->mutex);
  service_->hanging = on;
}

void FakeCoordinator::hang_deliveries(bool on) {
  const std::lock_guard lock(service_->mutex);
  service_->hanging_deliveries = on;
}

void FakeCoordinator::withdraw(uint64_t samples, farm::v1::Directive directive) {
  service_->withdraw(samples, directive);
}

std::vector<int64_t> FakeCoordinator::film() const {
  const std::lock_guard lock(service_->mutex);
  return service_->film;
}

FakeCoordinator::Account FakeCoordinator::account() const {
  const std::lock_guard lock(service_->mutex);
  Account account = service_->account;
  account.open = service_->open();
  return account;
}

}  // namespace metrofarm::test
