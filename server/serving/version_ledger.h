// The list of the versions in a folder that several servers may share.
//
// A version's folder may be half-written, or left by a server that died. So a version exists when
// the ledger says so, and the ledger says so once the folder is complete.

#ifndef MANEUVER_SERVER_SERVING_VERSION_LEDGER_H_
#define MANEUVER_SERVER_SERVING_VERSION_LEDGER_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/security/resource_name.h"
#include "server/serving/maker.h"

namespace maneuver::serving {

// A change is durable once its call has returned OK. Safe to use from any thread. Errors of every
// method: those of the store. Methods with a maker: ABORTED if the maker's lease has ended.
class VersionLedger {
 public:
  struct Entry {
    security::ModelVersionName name;
    int64_t revision = 0;  // grows with each Change
  };

  virtual ~VersionLedger() = default;

  virtual absl::StatusOr<std::vector<Entry>> ListVersions() = 0;
  // Adds versions of a folder that had no ledger. Leaves out numbers that the ledger already knows.
  virtual absl::Status Adopt(const std::vector<security::ModelVersionName>& present) = 0;
  // Keeps the numbers of deleted versions from being given again.
  virtual absl::Status AdoptDeleted(const std::vector<security::ModelVersionName>& deleted) = 0;

  // Takes the number after the highest that `model` ever had. It is never taken again.
  virtual absl::StatusOr<int> Reserve(const std::string& model, const Maker& maker) = 0;
  // Makes the version of a reserved number exist. NOT_FOUND if the number is not reserved.
  virtual absl::Status Announce(const security::ModelVersionName& name, const Maker& maker) = 0;
  // Removes a version from the list. NOT_FOUND if it is not there, FAILED_PRECONDITION while an
  // alias points to it.
  virtual absl::Status Retract(const security::ModelVersionName& name) = 0;
  // Calls `edit`, which changes files of a version, while nobody else changes or retracts the
  // version. `edit` must not call the store. NOT_FOUND if there is no such version; the error of
  // `edit`. If the store is lost after `edit`, the files have changed all the same.
  virtual absl::Status Change(const security::ModelVersionName& name, const Maker& maker,
                              const std::function<absl::Status()>& edit) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_VERSION_LEDGER_H_
