#include "tests/postgresql/cluster.h"

#include <fcntl.h>
#include <grp.h>
#include <pwd.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/random.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <system_error>
#include <thread>

#include "absl/strings/str_cat.h"
#include "server/store/postgresql_connection.h"

namespace maneuver::postgresql {
namespace {

namespace fs = std::filesystem;

constexpr char kPrograms[] = "/usr/lib/postgresql/15/bin/";

std::string RandomHex() {
  unsigned char bytes[16];
  while (getrandom(bytes, sizeof(bytes), 0) != sizeof(bytes)) {
  }
  std::string hex;
  for (const unsigned char byte : bytes) absl::StrAppend(&hex, absl::Hex(byte, absl::kZeroPad2));
  return hex;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Cluster>> Cluster::Start(bool explains) {
  if (!fs::exists(absl::StrCat(kPrograms, "initdb"))) {
    return absl::NotFoundError(
        "PostgreSQL 15 is not installed: deploy/install-deps.sh --tests installs it");
  }
  std::unique_ptr<Cluster> cluster(new Cluster);
  cluster->explains_ = explains;
  cluster->user_ = getuid();
  cluster->group_ = getgid();
  if (cluster->user_ == 0) {  // which initdb refuses
    const passwd* user = getpwnam("postgres");
    if (user == nullptr) user = getpwnam("nobody");
    cluster->user_ = user->pw_uid;
    cluster->group_ = user->pw_gid;
  }
  std::string name = (fs::temp_directory_path() / "maneuver-pg-XXXXXX").string();
  if (mkdtemp(name.data()) == nullptr) return absl::InternalError("no folder can be made");
  cluster->folder_ = name;
  if (chown(name.c_str(), cluster->user_, cluster->group_) != 0) {
    return absl::InternalError("the folder cannot be given to the user");
  }
  cluster->password_ = RandomHex();
  const fs::path password_file = cluster->folder_ / "password";
  const fs::path pgpass = cluster->folder_ / "pgpass";
  std::ofstream(password_file) << cluster->password_ << "\n";
  std::ofstream(pgpass) << "*:*:*:maneuver:" << cluster->password_ << "\n";
  fs::permissions(pgpass, fs::perms::owner_read | fs::perms::owner_write);
  const int status = cluster->Run(
      {absl::StrCat(kPrograms, "initdb"), "--no-locale", "--encoding=UTF8", "--username=maneuver",
       "--auth=scram-sha-256", absl::StrCat("--pwfile=", password_file.string()),
       absl::StrCat("--pgdata=", (cluster->folder_ / "data").string())});
  if (status != 0) {
    return absl::InternalError(
        absl::StrCat("initdb failed; see ", (cluster->folder_ / "log").string()));
  }
  if (absl::Status resumed = cluster->Resume(); !resumed.ok()) return resumed;
  return cluster;
}

Cluster::~Cluster() {
  if (server_ > 0) {
    Signal(SIGCONT);
    Stop(SIGQUIT);
  }
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

pid_t Cluster::Spawn(const std::vector<std::string>& command) const {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const std::string log = folder_ / "log";
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child != 0) return child;
  const int output = open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0666);
  dup2(output, STDOUT_FILENO);
  dup2(output, STDERR_FILENO);
  if (getuid() == 0 && (setgroups(0, nullptr) != 0 || setgid(group_) != 0 || setuid(user_) != 0)) {
    _exit(126);
  }
  // After the change of user, which clears it: it ends with the test, however that ends.
  prctl(PR_SET_PDEATHSIG, SIGQUIT);
  if (getppid() != parent || chdir("/") != 0) _exit(126);
  execv(arguments[0], arguments.data());
  _exit(127);
}

int Cluster::Run(const std::vector<std::string>& command) const {
  int status = -1;
  waitpid(Spawn(command), &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::string Cluster::address() const {
  return absl::StrCat("postgresql://maneuver@/postgres?host=", folder_.string(),
                      "&passfile=", (folder_ / "pgpass").string());
}

std::string Cluster::NewSchema() {
  const std::string schema = absl::StrCat("store_", ++schemas_);
  auto connection = store::PostgresqlConnection::Open(address());
  if (!connection.ok() || !(*connection)->RunScript(absl::StrCat("CREATE SCHEMA ", schema)).ok()) {
    return "";
  }
  return absl::StrCat(address(), "&options=-csearch_path%3D", schema);
}

void Cluster::Signal(int signal) const { kill(server_, signal); }

void Cluster::Stop(int signal) {
  Signal(signal);
  waitpid(server_, nullptr, 0);
  server_ = -1;
}

absl::Status Cluster::Resume() {
  std::vector<std::string> command = {absl::StrCat(kPrograms, "postgres"), "-D",
                                      (folder_ / "data").string(), "-k", folder_.string()};
  std::vector<std::string> settings = {"listen_addresses="};
  if (explains_) {
    settings.insert(settings.end(),
                    {"log_line_prefix=%a ", "session_preload_libraries=auto_explain",
                     "auto_explain.log_min_duration=0", "auto_explain.log_analyze=on",
                     "auto_explain.log_timing=off", "auto_explain.log_nested_statements=on"});
  }
  for (const std::string& setting : settings) command.insert(command.end(), {"-c", setting});
  server_ = Spawn(command);
  for (int i = 0; i < 600; ++i) {
    if (store::PostgresqlConnection::Open(address()).ok()) return absl::OkStatus();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  return absl::DeadlineExceededError("PostgreSQL does not take connections");
}

}  // namespace maneuver::postgresql
