// TLS between worker and coordinator.
#include <grpcpp/security/server_credentials.h>
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>

#include "rpc/security.h"
#include "tests/rpc/fake_coordinator.h"
#include "tests/rpc/running_worker.h"

namespace metrofarm::rpc {
namespace {

namespace fs = std::filesystem;
using test::eventually;
using test::FakeCoordinator;
using test::RunningWorker;

using X509Ptr = std::unique_ptr<X509, decltype(&X509_free)>;
using KeyPtr = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

template <class Write>
std::string pem(Write&& write) {
  BIO* bio = BIO_new(BIO_s_mem());
  write(bio);
  char* data = nullptr;
  const long size = BIO_get_mem_data(bio, &data);
  std::string text(data, static_cast<size_t>(size));
  BIO_free(bio);
  return text;
}

// A certificate and its key; signed by itself if there is no issuer.
class Identity {
 public:
  Identity(const std::string& name, const Identity* issuer, const std::string& alternative = "")
      : key_(EVP_EC_gen("P-256"), EVP_PKEY_free), certificate_(X509_new(), X509_free) {
    X509* c = certificate_.get();
    X509_set_version(c, 2);
    ASN1_INTEGER_set(X509_get_serialNumber(c), ++serial);
    X509_gmtime_adj(X509_getm_notBefore(c), -60);
    X509_gmtime_adj(X509_getm_notAfter(c), 3600);
    X509_NAME_add_entry_by_txt(X509_get_subject_name(c), "CN", MBSTRING_ASC,
                               reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1, 0);
    const X509* by = issuer == nullptr ? c : issuer->certificate_.get();
    X509_set_issuer_name(c, X509_get_subject_name(by));
    X509_set_pubkey(c, key_.get());
    extend(NID_basic_constraints, issuer == nullptr ? "critical,CA:TRUE" : "critical,CA:FALSE");
    if (!alternative.empty()) extend(NID_subject_alt_name, alternative);
    X509_sign(c, issuer == nullptr ? key_.get() : issuer->key_.get(), EVP_sha256());
  }

  std::string certificate() const {
    return pem([&](BIO* bio) { PEM_write_bio_X509(bio, certificate_.get()); });
  }
  std::string key() const {
    return pem([&](BIO* bio) {
      PEM_write_bio_PrivateKey(bio, key_.get(), nullptr, nullptr, 0, nullptr, nullptr);
    });
  }

 private:
  void extend(int nid, const std::string& value) {
    X509_EXTENSION* extension = X509V3_EXT_conf_nid(nullptr, nullptr, nid, value.c_str());
    X509_add_ext(certificate_.get(), extension, -1);
    X509_EXTENSION_free(extension);
  }

  inline static long serial = 0;
  KeyPtr key_;
  X509Ptr certificate_;
};

class TlsTest : public testing::Test {
 protected:
  TlsTest() {
    directory_ = fs::temp_directory_path() / ("metrofarm-tls-test-" + std::to_string(getpid()));
    fs::create_directories(directory_);
    files_ = {path("ca.pem"), path("worker.pem"), path("worker.key")};
    write(files_.ca, ca_.certificate());
    write_worker(worker_);
  }
  ~TlsTest() override {
    std::error_code ignored;
    fs::remove_all(directory_, ignored);
  }

  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  static void write(const std::string& file, const std::string& content) {
    std::ofstream(file + ".new") << content;
    fs::rename(file + ".new", file);
  }
  void write_worker(const Identity& identity) {
    write(files_.key, identity.key());
    write(files_.certificate, identity.certificate());
  }

  // A coordinator that demands certificates of the CA.
  std::shared_ptr<grpc::ServerCredentials> server(const Identity& identity) const {
    grpc::SslServerCredentialsOptions options(
        GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
    options.pem_root_certs = ca_.certificate();
    options.pem_key_cert_pairs.push_back({identity.key(), identity.certificate()});
    return grpc::SslServerCredentials(options);
  }
  // Whether a worker with these files gets to work.
  static bool works(FakeCoordinator& farm, RunningWorker& worker, const TlsFiles& files) {
    const int all = start(farm, worker, files);
    return eventually([&] { return farm.account().delivered == all; });
  }
  // Whether it does not get to work for a few seconds.
  static bool is_refused(FakeCoordinator& farm, RunningWorker& worker, const TlsFiles& files) {
    const int all = start(farm, worker, files);
    std::this_thread::sleep_for(std::chrono::seconds(6));
    return farm.account().delivered < all;
  }
  // Starts the worker; how many segments are delivered once it has done its work.
  static int start(FakeCoordinator& farm, RunningWorker& worker, const TlsFiles& files) {
    const auto credentials = make_credentials(files, false, worker.options.coordinators);
    EXPECT_TRUE(credentials.ok()) << credentials.error().to_string();
    worker.options.credentials = credentials.value();
    const int all = farm.account().delivered + 5;
    farm.add_segments(5);
    worker.start();
    return all;
  }
  std::string refusal(const TlsFiles& files) const {
    const auto credentials = make_credentials(files, false, {});
    return credentials.ok() ? "" : credentials.error().to_string();
  }

  Identity ca_{"farm CA", nullptr}, other_ca_{"another CA", nullptr};
  Identity coordinator_{"coordinator", &ca_, "IP:127.0.0.1"}, worker_{"worker", &ca_};
  fs::path directory_;
  TlsFiles files_;
};

TEST_F(TlsTest, BothSidesKnowEachOther) {
  FakeCoordinator farm(server(coordinator_));
  RunningWorker worker(farm.address());
  EXPECT_TRUE(works(farm, worker, files_)) << worker.log();
}

TEST_F(TlsTest, AWorkerOfAnotherCaIsRefused) {
  write_worker(Identity("intruder", &other_ca_));
  FakeCoordinator farm(server(coordinator_));
  RunningWorker worker(farm.address());
  EXPECT_TRUE(is_refused(farm, worker, files_));
  EXPECT_EQ(farm.account().registered, 0);
}

TEST_F(TlsTest, AWorkerWithoutCertificateIsRefused) {
  FakeCoordinator farm(server(coordinator_));
  RunningWorker worker(farm.address());
  EXPECT_TRUE(is_refused(farm, worker, {files_.ca, "", ""}));
  EXPECT_EQ(farm.account().registered, 0);
}

TEST_F(TlsTest, ACoordinatorOfAnotherCaIsNotTrusted) {
  FakeCoordinator farm(server(Identity("coordinator", &other_ca_, "IP:127.0.0.1")));
  RunningWorker worker(farm.address());
  EXPECT_TRUE(is_refused(farm, worker, files_));
  EXPECT_EQ(farm.account().registered, 0);
}

TEST_F(TlsTest, ACertificateForAnotherNameIsNotTrusted) {
  FakeCoordinator farm(server(Identity("coordinator", &ca_, "DNS:other.example")));
  RunningWorker worker(farm.address());
  EXPECT_TRUE(is_refused(farm, worker, files_));
  EXPECT_EQ(farm.account().registered, 0);
}

TEST_F(TlsTest, TheNameThatWasAskedForCounts) {
  FakeCoordinator farm(server(Identity("coordinator", &ca_, "DNS:farm.example")));
  RunningWorker worker("farm.example:7070");
  worker.options.resolve = [&](const HostPort& name) -> Result<std::set<Endpoint>> {
    return std::set<Endpoint>{{farm.address(), name.to_string()}};
  };
  EXPECT_TRUE(works(farm, worker, files_)) << worker.log();
}

TEST_F(TlsTest, ReplacedFilesAreTakenUp) {
  write_worker(Identity("intruder", &other_ca_));
  FakeCoordinator farm(server(coordinator_));
  RunningWorker worker(farm.address());
  ASSERT_TRUE(is_refused(farm, worker, files_));
  write_worker(worker_);
  EXPECT_TRUE(eventually([&] { return farm.account().delivered == 5; })) << worker.log();
}

TEST_F(TlsTest, WrongFilesAreNamed) {
  const auto names = [](const std::string& message, const std::string& what) {
    return message.find(what) != std::string::npos;
  };
  EXPECT_EQ(refusal(files_), "");
  TlsFiles files = files_;
  files.key = files_.certificate;
  EXPECT_TRUE(names(refusal(files), "--tls-key")) << refusal(files);
  files = files_;
  files.certificate = files_.ca;
  EXPECT_TRUE(names(refusal(files), "is not the key of the certificate")) << refusal(files);
  files = files_;
  files.certificate = path("missing.pem");
  EXPECT_TRUE(names(refusal(files), "--tls-cert: cannot read")) << refusal(files);
  write(path("ca.pem"), "no certificate");
  EXPECT_TRUE(names(refusal(files_), "--tls-ca")) << refusal(files_);
}

}  // namespace
}  // namespace metrofarm::rpc
