// How much memory the process of a job will take.

#ifndef MANEUVER_SERVER_JOBS_JOB_MEMORY_H_
#define MANEUVER_SERVER_JOBS_JOB_MEMORY_H_

#include <cstdint>

#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/data/dataset_store.h"

namespace maneuver::jobs {

// Returns an estimate from the settings of a job and the manifests of its datasets. Reads no
// recording.
//   job: with complete settings
//   spec: the spec of the model to evaluate; for a training, the settings contain it
//   data_memory: JobLimits.data_memory
// Errors: those of DatasetStore::Read.
absl::StatusOr<v1::JobMemory> EstimateMemory(const v1::Job& job, const v1::ModelSpec& spec,
                                             const data::DatasetStore& datasets,
                                             int64_t data_memory);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_JOB_MEMORY_H_
