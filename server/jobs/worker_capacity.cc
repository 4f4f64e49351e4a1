#include "server/jobs/worker_capacity.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace maneuver::jobs {
namespace {

std::string Gibibytes(int64_t bytes) {
  return absl::StrFormat("%.1f GiB", static_cast<double>(bytes) / (int64_t{1} << 30));
}

}  // namespace

JobNeeds NeedsOf(const v1::Job& job) {
  JobNeeds needs;
  const std::string& device =
      job.has_train() ? job.train().settings().device() : job.cross_validate().settings().device();
  if (!device.empty()) needs.device = device;
  needs.ranks = std::max(1, job.train().ranks());
  needs.memory_bytes = needs.ranks * job.memory().total_bytes();
  return needs;
}

bool WorkerCapacity::CanRun(const JobNeeds& needs) const {
  return devices.contains(needs.device) && needs.ranks <= ranks &&
         needs.memory_bytes <= memory_bytes;
}

std::string WhyNobodyRuns(const JobNeeds& needs, const std::vector<WorkerCapacity>& workers) {
  if (workers.empty()) {
    return "no server that runs jobs is up; start one with --role work or --role all";
  }
  std::set<std::string> devices;
  int64_t ranks = 0;
  int64_t memory_bytes = 0;
  for (const WorkerCapacity& worker : workers) {
    if (worker.CanRun(needs)) return "";
    devices.insert(worker.devices.begin(), worker.devices.end());
    ranks = std::max(ranks, worker.ranks);
    memory_bytes = std::max(memory_bytes, worker.memory_bytes);
  }
  std::vector<std::string> lacks;
  if (!devices.contains(needs.device)) {
    lacks.push_back(absl::StrCat("it needs the device ", needs.device,
                                 ", and the servers that run jobs have ",
                                 absl::StrJoin(devices, ", ")));
  }
  if (needs.ranks > ranks) {
    lacks.push_back(absl::StrCat("it needs ", needs.ranks,
                                 " ranks, and the servers that run jobs take at most ", ranks,
                                 " (--job-ranks)"));
  }
  if (needs.memory_bytes > memory_bytes) {
    lacks.push_back(absl::StrCat("it needs ", Gibibytes(needs.memory_bytes),
                                 ", and the servers that run jobs have at most ",
                                 Gibibytes(memory_bytes), " for one (--job-memory)"));
  }
  if (lacks.empty()) {
    return "no server that runs jobs has its device, its ranks and its memory together";
  }
  return absl::StrJoin(lacks, "; ");
}

}  // namespace maneuver::jobs
