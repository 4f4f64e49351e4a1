// What a server keeps beside its files: jobs with their progress, and aliases. A store that several
// servers may share also says which versions and datasets exist.

#ifndef MANEUVER_SERVER_STORE_STORE_H_
#define MANEUVER_SERVER_STORE_STORE_H_

#include <functional>
#include <memory>

#include "model/data/dataset_ledger.h"
#include "server/jobs/job_store.h"
#include "server/jobs/replica_registry.h"
#include "server/serving/alias_store.h"
#include "server/serving/version_ledger.h"

namespace maneuver::store {

// Listens until it is destroyed.
class StoreListener {
 public:
  virtual ~StoreListener() = default;
};

class Store : public jobs::JobStore, public serving::AliasStore {
 public:
  // Returns the ledger of versions; nullptr if no other server can ever use this store.
  virtual serving::VersionLedger* Ledger() { return nullptr; }
  // Returns the ledger of datasets; nullptr if no other server can ever use this store.
  virtual data::DatasetLedger* Datasets() { return nullptr; }
  // Returns the list of the servers that share this store; nullptr if no other server uses it.
  virtual jobs::ReplicaRegistry* Replicas() { return nullptr; }
  // Calls `changed`, from a thread of the returned object, soon after a server has changed an alias
  // or a version, and sometimes without a change. A change may go unheard, so ask the store at
  // intervals, too. Returns nullptr if no other server uses this store.
  virtual std::unique_ptr<StoreListener> ListenForModels(std::function<void()> /*changed*/) {
    return nullptr;
  }
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_H_
