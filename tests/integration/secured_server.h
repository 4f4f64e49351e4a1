#ifndef MANEUVER_TESTS_INTEGRATION_SECURED_SERVER_H_
#define MANEUVER_TESTS_INTEGRATION_SECURED_SERVER_H_

#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "tests/integration/server_process.h"
#include "tests/integration/test_certificates.h"

namespace maneuver::integration {

// A folder with the certificates and tokens of a secured server, which reads them again while it
// runs.
class SecuredFolder {
 public:
  SecuredFolder();

  const std::filesystem::path& path() const { return folder_.path(); }
  std::filesystem::path file(const std::string& name) const { return folder_.path() / name; }
  std::string Read(const std::string& name) const;
  // Returns the server's log.
  std::string log_text() const { return Read("data.log"); }

  // Writes server.crt and then server.key, each in one step.
  void Install(const TestCertificate& certificate) const;
  // Replaces a file in one step. Only its owner may read it.
  void Write(const std::string& name, const std::string& content) const;
  // Creates a token by "maneuverd token create", which adds its line to `tokens`.
  std::string CreateToken(const std::string& name, const std::string& roles) const;

  // Starts a server over <folder>/data with TLS by server.crt and server.key.
  std::unique_ptr<ServerProcess> StartTls(std::vector<std::string> flags = {}) const;
  // Starts the same server in plain text.
  std::unique_ptr<ServerProcess> Start(std::vector<std::string> flags = {}) const;

 private:
  TemporaryFolder folder_;
};

// Returns a new connection that no other channel shares.
//   roots: PEM; empty for plain text
std::shared_ptr<grpc::Channel> Connect(const ServerProcess& server, const std::string& roots,
                                       const TestCertificate& client = {});

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_SECURED_SERVER_H_
