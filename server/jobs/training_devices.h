// The devices that a training can run on here.

#ifndef MANEUVER_SERVER_JOBS_TRAINING_DEVICES_H_
#define MANEUVER_SERVER_JOBS_TRAINING_DEVICES_H_

#include <chrono>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"

namespace maneuver::jobs {

// Asks the trainer, when a device other than "cpu" is first wanted, until it answers: it alone
// links LibTorch.
// Thread-safe.
class TrainingDevices {
 public:
  //   trainer: the maneuver-trainer program.
  //   graphics: files of which a machine with the driver of a graphics processor has one
  TrainingDevices(std::string trainer, std::vector<std::filesystem::path> graphics)
      : trainer_(std::move(trainer)), graphics_(std::move(graphics)) {}

  // INVALID_ARGUMENT for the field settings.device if the trainer says that it cannot use `device`.
  // OK if it cannot be asked: the job itself then says what is wrong. May wait seconds, the first
  // time. Call it from a thread that lives as long as the server (RunChild).
  absl::Status Check(const std::string& device);
  // Returns the devices that the trainer can use; "cpu" alone if it cannot be asked. Asks only on a
  // machine that has a device of a graphics processor. Waits, and is to be called, as Check.
  std::set<std::string> Usable();

 private:
  // Returns what the trainer lists; nothing if it does not answer.
  std::optional<std::set<std::string>> Ask() const;

  const std::string trainer_;
  const std::vector<std::filesystem::path> graphics_;
  Mutex mutex_;
  std::optional<std::set<std::string>> usable_ ABSL_GUARDED_BY(mutex_);
  std::chrono::steady_clock::time_point ask_at_ ABSL_GUARDED_BY(mutex_){};  // if it did not answer
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINING_DEVICES_H_
