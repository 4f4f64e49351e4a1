// Reads a whole store.

#ifndef MANEUVER_SERVER_STORE_STORE_CHECK_H_
#define MANEUVER_SERVER_STORE_STORE_CHECK_H_

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/store/store.h"

namespace maneuver::store {

struct StoreContents {
  std::map<v1::JobState, int64_t> jobs;
  int64_t events = 0;
  int64_t aliases = 0;
  std::optional<int64_t> datasets;  // nothing: the store has no ledger of them

  bool operator==(const StoreContents&) const = default;
  // Returns text such as "3 jobs (1 pending, 2 succeeded), 40 events, 2 aliases, 5 datasets".
  std::string ToString() const;
};

// Reads every job, event, alias and manifest of a dataset, compares each with its checksum, and
// counts them. DATA_LOSS for the first one that is damaged; other errors: those of the store.
absl::StatusOr<StoreContents> CheckStore(Store& store);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_CHECK_H_
