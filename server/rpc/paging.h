#ifndef MANEUVER_SERVER_RPC_PAGING_H_
#define MANEUVER_SERVER_RPC_PAGING_H_

#include <algorithm>

#include "absl/status/statusor.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {

// Returns the number of items on a page, for all List methods: 50 if the request does not say, at
// most 1000. INVALID_ARGUMENT for a negative number.
inline absl::StatusOr<int> PageSizeOf(int requested) {
  constexpr int kDefault = 50;
  constexpr int kLargest = 1000;
  if (requested < 0) return errors::InvalidField("page_size", "expected 0 or more");
  return requested == 0 ? kDefault : std::min(requested, kLargest);
}

// Returns INVALID_ARGUMENT for a page_token that no answer had.
inline absl::Status WrongPageToken() {
  return errors::InvalidField("page_token", "expected the next_page_token of a former answer");
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_PAGING_H_
