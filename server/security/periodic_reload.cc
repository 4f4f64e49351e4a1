#include "server/security/periodic_reload.h"

#include <utility>

#include "server/monitoring/logging.h"

namespace maneuver::security {
namespace {

using monitoring::Log;
using monitoring::LogLevel;

// `failure`: the error of the last check, so that a lasting error is logged only once.
void ReloadOne(const ReloadedFiles& files, std::string& failure) {
  const absl::StatusOr<bool> changed = files.reload();
  if (changed.ok()) {
    failure.clear();
    if (*changed) Log(LogLevel::kInfo, "reloaded", {{"what", files.what}});
    return;
  }
  std::string reason(changed.status().message());
  if (reason == failure) return;
  failure = std::move(reason);
  Log(LogLevel::kWarning, "cannot reload; keeps what was loaded before",
      {{"what", files.what}, {"reason", failure}});
}

}  // namespace

PeriodicReload::PeriodicReload(std::vector<ReloadedFiles> files, std::chrono::milliseconds interval)
    : thread_([this, files = std::move(files), interval] { Run(files, interval); }) {}

PeriodicReload::~PeriodicReload() {
  stop_.Stop();
  thread_.join();
}

void PeriodicReload::Run(std::vector<ReloadedFiles> files, std::chrono::milliseconds interval) {
  std::vector<std::string> failures(files.size());
  while (!stop_.StoppedWithin(interval)) {
    for (size_t i = 0; i < files.size(); ++i) ReloadOne(files[i], failures[i]);
  }
}

}  // namespace maneuver::security
