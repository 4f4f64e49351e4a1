// Makes the embedded store of a data folder usable again after damage.

#ifndef MANEUVER_SERVER_STORE_STORE_REPAIR_H_
#define MANEUVER_SERVER_STORE_STORE_REPAIR_H_

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/store/store_check.h"

namespace maneuver::store {

struct StoreRepair {
  StoreContents contents;              // of the store as it is now
  std::string damage;                  // what was wrong; empty: nothing, and nothing was changed
  std::filesystem::path damaged_file;  // where the damaged store is kept
  int64_t readable_jobs = 0;           // that come from the damaged store
  int64_t readable_aliases = 0;
  std::vector<std::string>
      dropped_aliases;  // models/{model}/aliases/{alias}: their versions are gone
};

// Replaces maneuver.db of `data_dir`, if it is damaged, by the one of `backup`, a folder that
// deploy/backup.sh made. Rows of the damaged store that can be read, with the right checksums, take
// the place of the back-up's, because they are newer; what cannot be read is as it was backed up.
// The damaged store is kept beside the new one. The caller holds the lock of the folder. After a
// crash the store is the damaged one or the repaired one; the call can be repeated.
//   backup: empty to keep only what can be read in the damaged store
//
// A job that was deleted after the back-up may be there again, and an alias that was removed.
// NOT_FOUND if the folder has no embedded store; INVALID_ARGUMENT if `backup` is not a back-up of
// one; DATA_LOSS if the back-up is damaged, too; those of SqliteStore::Open but DATA_LOSS.
absl::StatusOr<StoreRepair> RepairStore(const std::filesystem::path& data_dir,
                                        const std::filesystem::path& backup);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_REPAIR_H_
