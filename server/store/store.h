// What a server keeps beside its files: jobs with their progress, and aliases. A store that several
// servers may share also says which versions exist.

#ifndef MANEUVER_SERVER_STORE_STORE_H_
#define MANEUVER_SERVER_STORE_STORE_H_

#include "server/jobs/job_store.h"
#include "server/jobs/replica_registry.h"
#include "server/serving/alias_store.h"
#include "server/serving/version_ledger.h"

namespace maneuver::store {

class Store : public jobs::JobStore, public serving::AliasStore {
 public:
  // Returns the ledger of versions; nullptr if no other server can ever use this store.
  virtual serving::VersionLedger* Ledger() { return nullptr; }
  // Returns the list of the servers that share this store; nullptr if no other server uses it.
  virtual jobs::ReplicaRegistry* Replicas() { return nullptr; }
};

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORE_H_
