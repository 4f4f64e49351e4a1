#include "tests/integration/secured_server.h"

#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

namespace maneuver::integration {

namespace fs = std::filesystem;

SecuredFolder::SecuredFolder() { fs::create_directory(file("data")); }

std::string SecuredFolder::Read(const std::string& name) const {
  std::ostringstream text;
  text << std::ifstream(file(name)).rdbuf();
  return text.str();
}

void SecuredFolder::Write(const std::string& name, const std::string& content) const {
  const fs::path temporary = file("." + name + ".new");
  std::ofstream(temporary) << content;
  fs::permissions(temporary, fs::perms::owner_read | fs::perms::owner_write);
  fs::rename(temporary, file(name));
}

void SecuredFolder::Install(const TestCertificate& certificate) const {
  Write("server.crt", certificate.certificate);
  Write("server.key", certificate.key);
}

std::string SecuredFolder::CreateToken(const std::string& name, const std::string& roles) const {
  const fs::path out = file("created");
  fs::remove(out);
  const std::string script = std::string(MANEUVERD) + " token create --name " + name + " --roles " +
                             roles + " --tokens " + file("tokens").string() + " >" + out.string();
  std::string output;
  EXPECT_EQ(Run({"/bin/sh", "-c", script}, &output), 0) << output;
  std::string token;
  std::ifstream(out) >> token;
  EXPECT_EQ(output.find(token), std::string::npos);
  return token;
}

std::unique_ptr<ServerProcess> SecuredFolder::Start(std::vector<std::string> flags) const {
  return std::make_unique<ServerProcess>(file("data"), std::move(flags));
}

std::unique_ptr<ServerProcess> SecuredFolder::StartTls(std::vector<std::string> flags) const {
  flags.insert(flags.end(), {"--tls-certificate", file("server.crt").string(), "--tls-key",
                             file("server.key").string()});
  return Start(std::move(flags));
}

std::shared_ptr<grpc::Channel> Connect(const ServerProcess& server, const std::string& roots,
                                       const TestCertificate& client) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_RETRIES, 0);
  const auto credentials = roots.empty()
                               ? grpc::InsecureChannelCredentials()
                               : grpc::SslCredentials({roots, client.key, client.certificate});
  return grpc::CreateCustomChannel(server.address(), credentials, arguments);
}

}  // namespace maneuver::integration
