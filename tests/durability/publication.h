// Tests something that is written and then published in one step. A disk fault at any moment of
// this may leave only the old state or the new one.

#ifndef MANEUVER_TESTS_DURABILITY_PUBLICATION_H_
#define MANEUVER_TESTS_DURABILITY_PUBLICATION_H_

#include <filesystem>
#include <functional>

#include "absl/status/status.h"

namespace maneuver::durability {

struct Publication {
  // Makes the old state in an empty folder.
  std::function<void(const std::filesystem::path& folder)> prepare;
  // Publishes. If a fault has left the old state, it is called again and must then succeed.
  std::function<absl::Status(const std::filesystem::path& folder)> publish;
  // Recovers, as a starting program does. Returns whether the new state is there. Fails the test
  // unless exactly the old or the new state is there, complete.
  std::function<bool(const std::filesystem::path& folder)> is_new;
};

// Fails the test if any fault breaks the publication or leaves a file named *.tmp-* behind. Uses a
// new folder below `parent` for each fault. Returns the number of moments at which faults were
// tried.
int CheckEveryFault(const Publication& publication, const std::filesystem::path& parent);

}  // namespace maneuver::durability

#endif  // MANEUVER_TESTS_DURABILITY_PUBLICATION_H_
