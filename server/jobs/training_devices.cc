#include "server/jobs/training_devices.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/errors/error_details.h"
#include "server/jobs/child_process.h"

namespace maneuver::jobs {

absl::Status TrainingDevices::Check(const std::string& device) {
  if (device.empty() || device == "cpu") return absl::OkStatus();
  const MutexLock lock(mutex_);
  if (!usable_) usable_ = Ask();
  if (!usable_ || usable_->contains(device)) return absl::OkStatus();
  return errors::InvalidField(
      "settings.device",
      absl::StrCat("is \"", device, "\", which this server's trainer cannot use; it has ",
                   absl::StrJoin(*usable_, ", ")));
}

std::optional<std::set<std::string>> TrainingDevices::Ask() const {
  std::set<std::string> devices;
  StopRequest never;
  const auto result = RunChild(
      {.arguments = {trainer_, "devices"},
       .log = "/dev/null",
       .time_limit = std::chrono::seconds(20),
       .yields = false},
      never, [&devices](const std::string& line) { devices.insert(line); }, [] {});
  const bool answered =
      result.ok() && result->signal == 0 && result->exit_status == 0 && devices.contains("cpu");
  return answered ? std::optional(devices) : std::nullopt;
}

}  // namespace maneuver::jobs
