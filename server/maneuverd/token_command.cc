#include "server/maneuverd/token_command.h"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <string>

#include "absl/status/status.h"
#include "server/security/identities.h"
#include "server/security/secret_file.h"

namespace maneuver {
namespace {

constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;

int Fail(int status, const absl::Status& error) {
  std::cerr << "maneuverd token create: " << error.message() << "\n";
  return status;
}

int Create(const std::string& name, const std::string& roles_text,
           const std::filesystem::path& file) {
  const auto roles = security::RoleSet::Parse(roles_text);
  if (!roles.ok()) return Fail(kWrongUsage, roles.status());
  const std::string token = security::NewToken();
  const auto line = security::TokenLine(name, *roles, token);
  if (!line.ok()) return Fail(kWrongUsage, line.status());
  if (const auto status = security::AppendLine(file, *line); !status.ok()) {
    return Fail(kFailed,
                absl::Status(status.code(), file.string() + ": " + std::string(status.message())));
  }
  std::cerr << "The token of " << name << ", shown this once; " << file.string()
            << " keeps its SHA-256 alone:\n";
  std::cout << token << std::endl;
  return 0;
}

}  // namespace

int RunTokenCommand(int argc, char** argv) {
  std::string name;
  std::string roles;
  std::filesystem::path file;
  CLI::App app("maneuverd token: who may call the server");
  app.name("maneuverd token");
  app.require_subcommand(1);
  CLI::App* create = app.add_subcommand(
      "create",
      "Prints a new token on standard output and adds its line to FILE; a server that reads FILE "
      "knows it within a second. To take it back, delete its line");
  create->add_option("--name", name, "Whose token it is")->required();
  create->add_option("--roles", roles, "Any of predict, train and admin, separated by commas")
      ->required();
  create->add_option("--tokens", file, "The file, as of maneuverd --tokens")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongUsage;
  }
  return Create(name, roles, file);
}

}  // namespace maneuver
