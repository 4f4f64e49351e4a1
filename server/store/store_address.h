// Where a store is: in the data folder, or in PostgreSQL.

#ifndef MANEUVER_SERVER_STORE_STORE_ADDRESS_H_
#define MANEUVER_SERVER_STORE_STORE_ADDRESS_H_

#include <string>

#include "absl/status/status.h"

namespace maneuver::store {

// Checks the value of --store: empty for the embedded store, or a URI of libpq that begins with
// postgresql:// or postgres://. INVALID_ARGUMENT for anything else, for a URI that holds a
// password, and for one whose parameters have escaped names, which could. Messages never repeat the
// URI.
absl::Status CheckStoreAddress(const std::string& address);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_ADDRESS_H_
