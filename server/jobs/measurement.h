// Measures a version on a dataset, in a process of a job.

#ifndef MANEUVER_SERVER_JOBS_MEASUREMENT_H_
#define MANEUVER_SERVER_JOBS_MEASUREMENT_H_

#include <filesystem>
#include <optional>
#include <string>

#include "maneuver/v1/training_service.pb.h"
#include "server/jobs/job_attempt.h"

namespace maneuver::jobs {

struct MeasuringTask {
  std::string model;         // as EvaluateRequest.model
  std::string dataset;       // datasets/{dataset}
  int sampled_examples = 0;  // number of examples that the report contains
};

struct Measured {
  Outcome outcome;
  // Empty if the measurement failed, as `outcome` says, or if the job was asked to stop.
  std::optional<v1::EvaluationReport> report;
};

// Measures a version on the examples that the settings in `folder` define, and stores the report
// beside the version. If the version is deleted meanwhile, the report is only returned.
Measured Measure(v1::Job& job, const MeasuringTask& task, const std::filesystem::path& folder,
                 const JobAttempt& attempt);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_MEASUREMENT_H_
