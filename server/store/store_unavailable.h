// The error of a store that cannot be used at the moment. Private to the stores.

#ifndef MANEUVER_SERVER_STORE_STORE_UNAVAILABLE_H_
#define MANEUVER_SERVER_STORE_STORE_UNAVAILABLE_H_

#include <string>

#include "absl/status/status.h"

namespace maneuver::store {

// Returns UNAVAILABLE with the reason STORE_UNAVAILABLE and a retry delay. Whoever gets it leaves
// the log to the store.
absl::Status StoreUnavailable(const std::string& what);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_UNAVAILABLE_H_
