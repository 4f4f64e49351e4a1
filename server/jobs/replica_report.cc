#include "server/jobs/replica_report.h"

#include <chrono>
#include <string>
#include <utility>

namespace maneuver::jobs {
namespace {

constexpr std::chrono::seconds kLook{1};
constexpr std::chrono::seconds kLongestSilence{3};

}  // namespace

ReplicaReport::ReplicaReport(ReplicaRegistry& registry, std::function<v1::Replica()> replica)
    : registry_(registry), replica_(std::move(replica)) {
  thread_ = std::thread([this] { Run(); });
}

ReplicaReport::~ReplicaReport() {
  stop_.Stop();
  thread_.join();
  registry_.Leave().IgnoreError();  // it is forgotten after kReplicaLife
}

void ReplicaReport::Run() {
  std::string told;  // as bytes
  std::chrono::steady_clock::time_point told_at;
  do {
    const v1::Replica replica = replica_();
    std::string bytes = replica.SerializeAsString();
    const auto now = std::chrono::steady_clock::now();
    if (bytes == told && now - told_at < kLongestSilence) continue;
    // The store logs that it is away. The next look tells anew.
    told.clear();
    if (registry_.Report(replica).ok()) told = std::move(bytes);
    told_at = now;
  } while (!stop_.StoppedWithin(kLook));
}

}  // namespace maneuver::jobs
