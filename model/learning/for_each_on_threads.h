#ifndef MANEUVER_MODEL_LEARNING_FOR_EACH_ON_THREADS_H_
#define MANEUVER_MODEL_LEARNING_FOR_EACH_ON_THREADS_H_

#include <cstddef>
#include <functional>

#include "absl/status/status.h"

namespace maneuver::learning {

// Calls work(0) .. work(count - 1) on `threads` threads and waits for them. After an error, calls
// no more. Returns the first error that came.
absl::Status ForEachOnThreads(size_t count, int threads,
                              const std::function<absl::Status(size_t)>& work);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_FOR_EACH_ON_THREADS_H_
