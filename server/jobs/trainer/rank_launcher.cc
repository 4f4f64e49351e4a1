#include "server/jobs/trainer/rank_launcher.h"

#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <optional>
#include <system_error>
#include <thread>

#include "absl/strings/str_cat.h"
#include "model/learning/ranks/rank_group.h"
#include "server/jobs/trainer/stop_signal.h"
#include "server/jobs/trainer_protocol.h"

namespace maneuver::trainer {
namespace {

using jobs::TrainerExit;
using std::chrono::steady_clock;

// From the end of one rank to the end of the others: they notice a dead one at once.
constexpr std::chrono::seconds kPatience{5};
constexpr std::chrono::milliseconds kPoll{20};

struct Rank {
  pid_t pid = -1;
  std::optional<int> status;  // as waitpid has it, once it has ended
};

// The variables of this process with those of one rank.
std::vector<std::string> EnvironmentOf(int rank, int ranks, int port) {
  std::vector<std::string> environment = {absl::StrCat("RANK=", rank),
                                          absl::StrCat("WORLD_SIZE=", ranks),
                                          absl::StrCat("LOCAL_RANK=", rank),
                                          absl::StrCat("LOCAL_WORLD_SIZE=", ranks),
                                          "MASTER_ADDR=127.0.0.1",
                                          absl::StrCat("MASTER_PORT=", port),
                                          "TORCHELASTIC_USE_AGENT_STORE=True",
                                          "TORCHELASTIC_RESTART_COUNT=0"};
  const size_t own = environment.size();
  for (char** each = environ; *each != nullptr; ++each) {
    const std::string_view name(*each, strcspn(*each, "=") + 1);
    const auto end = environment.begin() + static_cast<std::ptrdiff_t>(own);
    if (std::none_of(environment.begin(), end,
                     [name](const std::string& set) { return set.starts_with(name); })) {
      environment.emplace_back(*each);
    }
  }
  return environment;
}

std::vector<char*> Pointers(const std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (const std::string& text : texts) pointers.push_back(const_cast<char*>(text.c_str()));
  pointers.push_back(nullptr);
  return pointers;
}

// Returns -1 if it cannot be started.
pid_t Start(const std::string& program, const std::vector<std::string>& arguments,
            const std::vector<std::string>& environment) {
  const std::vector<char*> argv = Pointers(arguments);
  const std::vector<char*> envp = Pointers(environment);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid != 0) return pid;
  // Nothing but system calls: other threads may hold any lock. A signal to the launcher's group
  // does not reach the rank, since the second SIGTERM of a process ends it at once.
  setpgid(0, 0);
  if (prctl(PR_SET_PDEATHSIG, SIGKILL) == 0 && getppid() == parent) {
    execve(program.c_str(), argv.data(), envp.data());
  }
  _exit(static_cast<int>(TrainerExit::kInternal));
}

bool Failed(const Rank& rank) { return rank.status && *rank.status != 0; }

// Reaps the ranks that have ended. Returns whether all have.
bool Reap(std::vector<Rank>& ranks) {
  bool all = true;
  for (Rank& rank : ranks) {
    int status = 0;
    if (!rank.status && waitpid(rank.pid, &status, WNOHANG) == rank.pid) rank.status = status;
    all = all && rank.status;
  }
  return all;
}

void Signal(const std::vector<Rank>& ranks, int signal) {
  for (const Rank& rank : ranks) {
    if (!rank.status) kill(rank.pid, signal);
  }
}

void WaitForAll(std::vector<Rank>& ranks) {
  bool stopped = false;
  std::optional<steady_clock::time_point> kill_at;
  while (!Reap(ranks)) {
    if (StopRequested() && !stopped) {
      Signal(ranks, SIGTERM);
      stopped = true;
    }
    const steady_clock::time_point now = steady_clock::now();
    // The others of a stopped run wait for rank 0's checkpoint.
    if (!kill_at && !stopped && std::ranges::any_of(ranks, Failed)) kill_at = now + kPatience;
    if (kill_at && now >= *kill_at) Signal(ranks, SIGKILL);
    std::this_thread::sleep_for(kPoll);
  }
}

int Summarize(const std::vector<Rank>& ranks) {
  constexpr int kLost = static_cast<int>(TrainerExit::kRankLost);
  int summary = 0;
  for (size_t i = 0; i < ranks.size(); ++i) {
    const int status = *ranks[i].status;
    if (WIFSIGNALED(status)) {
      const char* const name = sigabbrev_np(WTERMSIG(status));
      std::cerr << "maneuver-trainer: rank " << i << " was killed by signal " << WTERMSIG(status)
                << " (SIG" << (name != nullptr ? name : "?")
                << "); start all ranks again: they continue from the last checkpoint\n";
      if (summary == 0) summary = kLost;
      continue;
    }
    // A rank that failed by itself says more than those that lost it.
    if (const int exit = WEXITSTATUS(status); exit != 0 && (summary == 0 || summary == kLost)) {
      summary = exit;
    }
  }
  return summary;
}

}  // namespace

int RunRanks(int ranks, const std::vector<std::string>& arguments) {
  const absl::StatusOr<std::unique_ptr<learning::RankStore>> store = learning::RankStore::Serve();
  if (!store.ok()) return ExitStatus(store.status());
  std::error_code error;
  const std::string self = std::filesystem::read_symlink("/proc/self/exe", error);
  std::vector<Rank> started;
  for (int i = 0; i < ranks && !error; ++i) {
    const pid_t pid = Start(self, arguments, EnvironmentOf(i, ranks, (*store)->port()));
    if (pid < 0) error = std::error_code(errno, std::generic_category());
    if (pid > 0) started.push_back({pid, {}});
  }
  if (error) {
    Signal(started, SIGKILL);
    WaitForAll(started);
    return ExitStatus(absl::InternalError(absl::StrCat("cannot start a rank: ", error.message())));
  }
  WaitForAll(started);
  return Summarize(started);
}

}  // namespace maneuver::trainer
