// Stands between a client and PostgreSQL, and loses connections.

#ifndef MANEUVER_TESTS_POSTGRESQL_LOSSY_PROXY_H_
#define MANEUVER_TESTS_POSTGRESQL_LOSSY_PROXY_H_

#include <atomic>
#include <filesystem>
#include <thread>

namespace maneuver::postgresql {

// Passes on the bytes of one connection after the other between a Unix socket of its own and
// PostgreSQL's.
class LossyProxy {
 public:
  //   server: PostgreSQL's socket
  explicit LossyProxy(std::filesystem::path server);
  ~LossyProxy();
  LossyProxy(const LossyProxy&) = delete;
  LossyProxy& operator=(const LossyProxy&) = delete;

  // The folder of its socket, for host= of a URI.
  const std::filesystem::path& folder() const { return folder_; }

  // Cuts the connection at the next COMMIT.
  //   reaches: whether PostgreSQL gets it; only its answer is then lost
  void LoseNextCommit(bool reaches) { next_ = reaches ? Loss::kAnswer : Loss::kRequest; }
  // Returns how many COMMITs or answers were lost.
  int lost() const { return lost_; }

 private:
  enum class Loss { kNone, kRequest, kAnswer };

  void Serve();
  void Pass(int client);

  const std::filesystem::path server_;
  std::filesystem::path folder_;
  int listener_ = -1;
  std::atomic<Loss> next_ = Loss::kNone;
  std::atomic<int> lost_ = 0;
  std::atomic<bool> stops_ = false;
  std::thread thread_;
};

}  // namespace maneuver::postgresql

#endif  // MANEUVER_TESTS_POSTGRESQL_LOSSY_PROXY_H_
