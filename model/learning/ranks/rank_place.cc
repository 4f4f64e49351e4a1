#include "model/learning/ranks/rank_place.h"

#include <algorithm>
#include <bit>
#include <cstdlib>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace maneuver::learning {
namespace {

constexpr int kDefaultPort = 29'500;  // as torchrun has it
// Slurm jobs on one node at the same time have different ports.
constexpr int kFirstSlurmPort = 15'000;
constexpr int kSlurmPorts = 15'000;

// How one launcher calls what it tells its processes.
struct Launcher {
  const char* rank;
  const char* ranks;
  const char* also;  // must be set too, or else the launcher did not start this process; or nullptr
  const char* local_rank;
  const char* local_ranks;
};

constexpr Launcher kTorchrun = {"RANK", "WORLD_SIZE", nullptr, "LOCAL_RANK", "LOCAL_WORLD_SIZE"};
constexpr Launcher kSlurm = {"SLURM_PROCID", "SLURM_NTASKS", "SLURM_STEP_ID", "SLURM_LOCALID",
                             "SLURM_STEP_TASKS_PER_NODE"};
constexpr Launcher kKubernetes = {"JOB_COMPLETION_INDEX", "WORLD_SIZE", nullptr, nullptr, nullptr};
constexpr Launcher kOpenMpi = {"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", nullptr,
                               "OMPI_COMM_WORLD_LOCAL_RANK", "OMPI_COMM_WORLD_LOCAL_SIZE"};

absl::StatusOr<int> ReadNumber(const EnvironmentReader& read, const char* name, int least,
                               int most) {
  const std::string text = read(name).value_or("");
  int value = 0;
  if (!absl::SimpleAtoi(text, &value) || value < least || value > most) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, " is \"", text, "\", but must be a number from ", least, " to ", most));
  }
  return value;
}

// The first host of a list such as "node[08-11,20],other": "node08".
std::string FirstHost(const std::string& list) {
  const size_t end = list.find_first_of(",[");
  std::string host = list.substr(0, end);
  if (end == std::string::npos || list[end] == ',') return host;
  const size_t number = end + 1;
  const size_t number_end = list.find_first_of("-,]", number);
  host += list.substr(number, number_end - number);
  const size_t closing = list.find(']', number);
  if (closing == std::string::npos) return host;
  return host + list.substr(closing + 1, list.find(',', closing) - closing - 1);
}

absl::StatusOr<int> FindPort(const EnvironmentReader& read, bool is_slurm) {
  if (read("MASTER_PORT")) return ReadNumber(read, "MASTER_PORT", 1, 65'535);
  int64_t job = 0;
  if (is_slurm && absl::SimpleAtoi(read("SLURM_JOB_ID").value_or(""), &job)) {
    return static_cast<int>(kFirstSlurmPort + job % kSlurmPorts);
  }
  return kDefaultPort;
}

absl::StatusOr<std::string> FindHost(const EnvironmentReader& read, const RankPlace& place) {
  if (const auto host = read("MASTER_ADDR"); host && !host->empty()) return *host;
  if (place.local_ranks == place.ranks) return "127.0.0.1";
  for (const char* list : {"SLURM_STEP_NODELIST", "SLURM_JOB_NODELIST"}) {
    if (const auto hosts = read(list); hosts && !hosts->empty()) return FirstHost(*hosts);
  }
  return absl::InvalidArgumentError(
      "MASTER_ADDR is not set; export the name or the address of rank 0's machine in it");
}

absl::StatusOr<RankPlace> ReadPlace(const EnvironmentReader& read, const Launcher& launcher) {
  RankPlace place;
  const absl::StatusOr<int> ranks = ReadNumber(read, launcher.ranks, 1, 1024);
  if (!ranks.ok()) return ranks.status();
  place.ranks = *ranks;
  if (!std::has_single_bit(static_cast<unsigned>(place.ranks))) {
    return absl::InvalidArgumentError(
        absl::StrCat(launcher.ranks, " is ", place.ranks,
                     ", but the number of ranks must be a power of two; start 1, 2, 4 or 8"));
  }
  const absl::StatusOr<int> rank = ReadNumber(read, launcher.rank, 0, place.ranks - 1);
  if (!rank.ok()) return rank.status();
  place.rank = *rank;
  if (launcher.local_rank != nullptr && read(launcher.local_rank)) {
    const absl::StatusOr<int> local = ReadNumber(read, launcher.local_rank, 0, place.ranks - 1);
    if (!local.ok()) return local.status();
    place.local_rank = *local;
  }
  if (launcher.local_ranks != nullptr) {
    // Slurm's is a list: "2(x3),1".
    const std::string text = read(launcher.local_ranks).value_or("");
    const auto end = std::ranges::find_if_not(text, absl::ascii_isdigit);
    int local = 0;
    if (absl::SimpleAtoi(std::string(text.begin(), end), &local) && local <= place.ranks) {
      place.local_ranks = local;
    }
  }
  absl::StatusOr<std::string> host = FindHost(read, place);
  if (!host.ok()) return host.status();
  place.host = *std::move(host);
  const absl::StatusOr<int> port = FindPort(read, launcher.rank == kSlurm.rank);
  if (!port.ok()) return port.status();
  place.port = *port;
  place.attempt = read("TORCHELASTIC_RESTART_COUNT").value_or("0");
  place.serves_store = read("TORCHELASTIC_USE_AGENT_STORE").value_or("") != "True";
  return place;
}

}  // namespace

std::optional<std::string> ReadEnvironment(const std::string& name) {
  const char* const value = std::getenv(name.c_str());
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

absl::StatusOr<std::optional<RankPlace>> FindRankPlace(const EnvironmentReader& read) {
  for (const Launcher* launcher : {&kTorchrun, &kSlurm, &kKubernetes, &kOpenMpi}) {
    const bool has_also = launcher->also == nullptr || read(launcher->also);
    if (!read(launcher->rank) || !read(launcher->ranks) || !has_also) continue;
    absl::StatusOr<RankPlace> place = ReadPlace(read, *launcher);
    if (!place.ok()) return place.status();
    return std::optional(*std::move(place));
  }
  return std::nullopt;
}

}  // namespace maneuver::learning
