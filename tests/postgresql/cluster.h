// A PostgreSQL of a test's own.

#ifndef MANEUVER_TESTS_POSTGRESQL_CLUSTER_H_
#define MANEUVER_TESTS_POSTGRESQL_CLUSTER_H_

#include <sys/types.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace maneuver::postgresql {

// PostgreSQL 15 from Debian's packages, in a new folder, with its defaults, on a Unix socket alone.
// Roles need their password, which is in a file. It runs as an unprivileged user if the test is
// root's. The destructor ends it and removes the folder.
class Cluster {
 public:
  // NOT_FOUND if PostgreSQL is not installed: skip the test.
  //   explains: whether its log has the plan of each statement (query_plans.h)
  static absl::StatusOr<std::unique_ptr<Cluster>> Start(bool explains);
  ~Cluster();
  Cluster(const Cluster&) = delete;
  Cluster& operator=(const Cluster&) = delete;

  // Returns a URI of the database with a new, empty schema as its search path.
  std::string NewSchema();
  // Returns a URI of the whole database.
  std::string address() const;
  std::filesystem::path socket() const { return folder_ / ".s.PGSQL.5432"; }
  // Returns its log.
  std::filesystem::path log() const { return folder_ / "log"; }
  // Returns what must not be seen anywhere.
  const std::string& password() const { return password_; }

  // Sends a signal to the server itself: SIGSTOP, SIGCONT.
  void Signal(int signal) const;
  // Ends it: SIGINT as for `pg_ctl stop -m fast`, SIGQUIT as for `-m immediate`.
  void Stop(int signal);
  // Starts it over its folder again, and waits until it takes connections.
  absl::Status Resume();

 private:
  Cluster() = default;

  // Returns the exit status of a command that the unprivileged user runs.
  int Run(const std::vector<std::string>& command) const;
  pid_t Spawn(const std::vector<std::string>& command) const;

  std::filesystem::path folder_;
  std::string password_;
  uid_t user_ = 0;
  gid_t group_ = 0;
  pid_t server_ = -1;
  int schemas_ = 0;
  bool explains_ = false;
};

}  // namespace maneuver::postgresql

#endif  // MANEUVER_TESTS_POSTGRESQL_CLUSTER_H_
