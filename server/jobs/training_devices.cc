#include "server/jobs/training_devices.h"

#include <algorithm>
#include <chrono>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/errors/error_details.h"
#include "server/jobs/child_process.h"

namespace maneuver::jobs {
namespace {

constexpr std::chrono::minutes kBetweenQuestions{5};
// Less than other servers wait for a sign of life.
constexpr std::chrono::seconds kPatience{10};

}  // namespace

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

std::set<std::string> TrainingDevices::Usable() {
  const std::set<std::string> cpu = {"cpu"};
  std::error_code ignored;
  const bool has_graphics = std::ranges::any_of(
      graphics_, [&](const auto& file) { return std::filesystem::exists(file, ignored); });
  if (!has_graphics) return cpu;
  const MutexLock lock(mutex_);
  // A driver that is slow after a boot is asked again, now and then.
  if (const auto now = std::chrono::steady_clock::now(); !usable_ && now >= ask_at_) {
    usable_ = Ask();
    ask_at_ = now + kBetweenQuestions;
  }
  return usable_.value_or(cpu);
}

std::optional<std::set<std::string>> TrainingDevices::Ask() const {
  std::set<std::string> devices;
  StopRequest never;
  const auto result = RunChild(
      {.arguments = {trainer_, "devices"},
       .log = "/dev/null",
       .time_limit = kPatience,
       .yields = false},
      never, [&devices](const std::string& line) { devices.insert(line); }, [] {});
  const bool answered =
      result.ok() && result->signal == 0 && result->exit_status == 0 && devices.contains("cpu");
  return answered ? std::optional(devices) : std::nullopt;
}

}  // namespace maneuver::jobs
