// What a server keeps beside its files: jobs with their progress, and aliases.

#ifndef MANEUVER_SERVER_JOBS_STORE_H_
#define MANEUVER_SERVER_JOBS_STORE_H_

#include "server/jobs/job_store.h"
#include "server/serving/alias_store.h"

namespace maneuver::jobs {

class Store : public JobStore, public serving::AliasStore {};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_STORE_H_
