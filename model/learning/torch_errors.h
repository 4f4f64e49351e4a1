// Turns the exceptions of LibTorch into a Status, at the border of this folder.

#ifndef MANEUVER_MODEL_LEARNING_TORCH_ERRORS_H_
#define MANEUVER_MODEL_LEARNING_TORCH_ERRORS_H_

#include <ATen/ATen.h>

#include <exception>
#include <new>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/learning/training_failure.h"

namespace maneuver::learning {

// Returns work(), a Status or StatusOr. An exception becomes RESOURCE_EXHAUSTED with
// TrainingFailure::kOutOfMemory, or INTERNAL.
template <typename Work>
auto WithoutExceptions(Work&& work) -> decltype(work()) {
  try {
    return std::forward<Work>(work)();
  } catch (const c10::Error& error) {
    const std::string what = error.what_without_backtrace();
    // LibTorch's allocators of CPU and GPU have no exception of their own in all versions.
    if (what.find("allocate memory") != what.npos || what.find("out of memory") != what.npos) {
      return OutOfMemory();
    }
    return absl::InternalError(absl::StrCat("LibTorch: ", what));
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("LibTorch: ", error.what()));
  }
}

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_TORCH_ERRORS_H_
