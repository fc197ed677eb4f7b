#include "rpc/security.h"

#include <grpcpp/security/credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <cerrno>
#include <cstring>
#include <optional>

namespace metrofarm::rpc {

namespace {

// Looking at the files more often costs nothing and finds new certificates soon.
constexpr unsigned kRefreshSeconds = 10;

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;
using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;
using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

std::optional<Error> open_file(const std::string& option, const std::string& name, File& file) {
  file.reset(std::fopen(name.c_str(), "r"));
  if (file != nullptr) return std::nullopt;
  return Error{"--" + option + ": cannot read " + name + ": " + std::strerror(errno)};
}

std::optional<Error> read_certificate(const std::string& option, const std::string& name,
                                      Certificate& certificate) {
  File file(nullptr, std::fclose);
  if (auto error = open_file(option, name, file)) return error;
  certificate.reset(PEM_read_X509(file.get(), nullptr, nullptr, nullptr));
  if (certificate != nullptr) return std::nullopt;
  return Error{"--" + option + ": " + name + " does not begin with a certificate in PEM format"};
}

std::optional<Error> read_key(const std::string& option, const std::string& name, Key& key) {
  File file(nullptr, std::fclose);
  if (auto error = open_file(option, name, file)) return error;
  // An empty passphrase: nobody is there to be asked for another.
  char empty[] = "";
  key.reset(PEM_read_PrivateKey(file.get(), nullptr, nullptr, empty));
  if (key != nullptr) return std::nullopt;
  return Error{"--" + option + ": " + name +
               " is not a private key in PEM format without passphrase"};
}

std::optional<Error> check(const TlsFiles& files) {
  if (files.certificate.empty() != files.key.empty())
    return Error{"--tls-cert and --tls-key belong together"};
  if (files.ca.empty()) return Error{"--tls-cert and --tls-key need --tls-ca, too"};
  Certificate certificate(nullptr, X509_free);
  Key key(nullptr, EVP_PKEY_free);
  if (auto error = read_certificate("tls-ca", files.ca, certificate)) return error;
  if (files.certificate.empty()) return std::nullopt;
  if (auto error = read_certificate("tls-cert", files.certificate, certificate)) return error;
  if (auto error = read_key("tls-key", files.key, key)) return error;
  if (X509_check_private_key(certificate.get(), key.get()) != 1)
    return Error{"--tls-key: " + files.key + " is not the key of the certificate in " +
                 files.certificate};
  return std::nullopt;
}

std::shared_ptr<grpc::ChannelCredentials> tls(const TlsFiles& files) {
  using grpc::experimental::FileWatcherCertificateProvider;
  grpc::experimental::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(std::make_shared<FileWatcherCertificateProvider>(
      files.key, files.certificate, files.ca, kRefreshSeconds));
  options.watch_root_certs();
  if (!files.certificate.empty()) options.watch_identity_key_cert_pairs();
  return grpc::experimental::TlsCredentials(options);
}

}  // namespace

Result<std::shared_ptr<grpc::ChannelCredentials>> make_credentials(
    const TlsFiles& files, bool insecure, const std::vector<HostPort>& coordinators) {
  if (!files.ca.empty() || !files.certificate.empty() || !files.key.empty()) {
    if (insecure) return Error{"--insecure and --tls-... exclude each other"};
    if (auto error = check(files)) return *error;
    return tls(files);
  }
  for (const HostPort& coordinator : coordinators) {
    if (insecure || coordinator.is_loopback()) continue;
    return Error{
        "--coordinator: " + coordinator.to_string() +
        " is another machine: give --tls-ca, --tls-cert and --tls-key, or --insecure where "
        "the network is trusted"};
  }
  return grpc::InsecureChannelCredentials();
}

}  // namespace metrofarm::rpc
