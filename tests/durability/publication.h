// Something that is written and then made known in one step, and what every fault of the disk, at
// each moment of it, may leave: the old or the new, and nothing else.

#ifndef MANEUVER_TESTS_DURABILITY_PUBLICATION_H_
#define MANEUVER_TESTS_DURABILITY_PUBLICATION_H_

#include <filesystem>
#include <functional>

#include "absl/status/status.h"

namespace maneuver::durability {

struct Publication {
  // Makes the old state in an empty folder.
  std::function<void(const std::filesystem::path& folder)> prepare;
  // Publishes. Called again after it failed it is to succeed.
  std::function<absl::Status(const std::filesystem::path& folder)> publish;
  // Recovers, as a program that starts does, and says what is there: whether it is the new state.
  // Fails the test if it is neither that nor the old one, each whole.
  std::function<bool(const std::filesystem::path& folder)> is_new;
};

// Fails the test if a fault breaks the publication, in new folders of `parent` each. Returns how
// many moments it has.
int CheckEveryFault(const Publication& publication, const std::filesystem::path& parent);

}  // namespace maneuver::durability

#endif  // MANEUVER_TESTS_DURABILITY_PUBLICATION_H_
