#include "server/store/store_unavailable.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "server/errors/error_details.h"

namespace maneuver::store {

absl::Status StoreUnavailable(const std::string& what) {
  constexpr std::chrono::seconds kRetryDelay{2};
  return errors::WithRetryDelay(
      errors::WithReason(absl::UnavailableError(absl::StrCat("the job store: ", what)),
                         "STORE_UNAVAILABLE"),
      kRetryDelay);
}

}  // namespace maneuver::store
