// Encodes jobs and manifests for storage, and makes the errors of a job store, for any database.
// Private to the stores.

#ifndef MANEUVER_SERVER_STORE_STORED_JOB_H_
#define MANEUVER_SERVER_STORE_STORED_JOB_H_

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "locks/mutex.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_store.h"
#include "server/security/resource_name.h"
#include "server/serving/alias_store.h"

namespace maneuver::store {

// Return the bytes of a row: a message, and its CRC-32C as a field with a number that no message
// defines. Earlier releases wrote no CRC-32C, and they ignore the field.
//
// A job's row is maneuver.v1.Job without progress, which has rows of its own.
std::string StoredJob(v1::Job job);
std::string StoredProgress(const v1::JobProgress& progress);
std::string StoredDataset(const v1::Dataset& manifest);

// Returns the event of a row. DATA_LOSS if its CRC does not match, it does not parse, or its
// sequence differs.
//   sequence: the column of the row
absl::StatusOr<v1::JobProgress> ParseStoredProgress(int64_t sequence, const std::string& bytes);
// The columns of a row that repeat what its job says.
struct JobKey {
  std::string name;
  int64_t state = 0;
};
// Returns the job of a row and its latest event, if it has one. If the job has ended, its progress
// has no remaining time; if it has SUCCEEDED, the fraction is 1. DATA_LOSS as for
// ParseStoredProgress, or if the key differs from the job's. The error names the key.
absl::StatusOr<v1::Job> ParseStoredJob(const JobKey& key, const std::string& job,
                                       const std::optional<std::string>& progress);

// Logs the damaged jobs that a store finds. Thread-safe.
class DamageLog {
 public:
  // Writes a line, once for each job.
  //   damage: what ParseStoredJob returned
  void Report(const absl::Status& damage);

 private:
  Mutex mutex_;
  std::set<std::string> reported_ ABSL_GUARDED_BY(mutex_);
};

// Adds the job of a row to a page; or the error of one that is damaged, which it also logs.
//   name: the column of the row
void AddToPage(absl::StatusOr<v1::Job> job, const std::string& name, DamageLog& damage,
               jobs::JobPage* page);

// Returns the manifest of a row. DATA_LOSS as for ParseStoredProgress, or if its name differs.
//   name: datasets/{id}, after the row's key
absl::StatusOr<v1::Dataset> ParseStoredDataset(const std::string& name, const std::string& bytes);

// Returns when the job was created, microseconds since 1970.
int64_t CreateMicros(const v1::Job& job);

// Returns the CRC-32C that the row of an alias has.
int64_t AliasDigest(const security::ModelAliasName& name, int64_t version);
// Returns the alias of a row. DATA_LOSS if its digest does not match.
//   digest: nothing in the rows of early releases.
absl::StatusOr<serving::ModelAlias> StoredAlias(const security::ModelAliasName& name,
                                                int64_t version, std::optional<int64_t> digest);

// Returns the priority of the request that created the job; higher goes first.
int64_t PriorityOf(const v1::Job& job);

// Returns the number of the job that the previous page ended with; the greatest number for an empty
// token. INVALID_ARGUMENT if ListJobs did not make the token.
absl::StatusOr<int64_t> ParsePageToken(const std::string& page_token);

// Changes a RUNNING job by `end`. FAILED_PRECONDITION if the job may not move to its new state.
absl::Status EditRunning(const jobs::JobEdit& end, v1::Job& job);

// Returns FAILED_PRECONDITION unless JobStore::Move may take a job from `from` to `to`.
absl::Status CheckMove(v1::JobState from, v1::JobState to);

// Return NOT_FOUND; HasAlias FAILED_PRECONDITION, for a version that an alias points to; LeaseEnded
// ABORTED.
absl::Status NoSuchJob(const std::string& name);
absl::Status NoSuchAlias(const security::ModelAliasName& name);
absl::Status NoSuchVersion(const security::ModelVersionName& name);
absl::Status HasAlias(const security::ModelVersionName& name);
absl::Status LeaseEnded(const jobs::JobLease& lease);
// Return FAILED_PRECONDITION and name the job's state: IsInState because the state does not allow
// the request, NotEnded because the job has not ended.
absl::Status IsInState(const v1::Job& job);
absl::Status NotEnded(const v1::Job& job);

}  // namespace maneuver::store

#endif  // MANEUVER_SERVER_STORE_STORED_JOB_H_
