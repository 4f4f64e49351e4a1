// Decides whether a new version becomes the serving one: PROMOTION_IF_NO_WORSE.

#ifndef MANEUVER_SERVER_JOBS_PROMOTION_H_
#define MANEUVER_SERVER_JOBS_PROMOTION_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::jobs {

// Returns criteria with defaults filled in: min_ade_6 and nll, and the preset's examples.
v1::PromotionCriteria ResolveCriteria(v1::PromotionCriteria criteria);

// The decision to make.
struct PromotionTask {
  std::string model;               // models/{model}
  std::string version;             // the new one, models/{model}/versions/{version}
  v1::PromotionCriteria criteria;  // complete
  std::string dataset_sha256;      // as EvaluationReport.dataset_sha256
};

// The versions that a decision reads and changes, and its notes.
class PromotionVersions {
 public:
  struct MeasuredVersion {
    absl::Status status;
    // The measurement was cut off: its process died, or the job was asked to stop. Another process
    // can try again.
    bool interrupted = false;
    v1::EvaluationReport report;  // if the status is OK, and nothing interrupted
  };

  virtual ~PromotionVersions() = default;
  // Returns the version that serves the model; empty: none does.
  virtual std::string Serving() = 0;
  // Returns the stored report of a version on the criteria's dataset; an error if there is none.
  virtual absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) = 0;
  // Measures a version by the criteria, and stores the report.
  virtual MeasuredVersion Measure(const std::string& version) = 0;
  // Makes a version serve, but only if `before` serves now (empty: if none does). Otherwise returns
  // false.
  virtual absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) = 0;
  // Stores a decision before it is carried out, so that it survives a crash of the server.
  virtual absl::Status Remember(const v1::PromotionDecision& decision) = 0;
  // Returns the last stored decision, if there is one.
  virtual std::optional<v1::PromotionDecision> Remembered() = 0;
};

// The result of MeasureVersions or DecidePromotion. If there is no decision, call the same function
// again: it repeats no measurement that was finished.
struct PromotionOutcome {
  std::optional<v1::PromotionDecision> decision;  // without its time
  // Why there is no decision: the error that interrupted the function. OK if MeasureVersions has
  // measured all versions, and DecidePromotion is to follow.
  absl::Status interruption;
};

// Returns the versions that MeasureVersions has to measure: those that DecidePromotion would
// compare now and that have no report by the task's criteria.
std::vector<std::string> VersionsToMeasure(const PromotionTask& task, PromotionVersions& versions);

// Measures VersionsToMeasure. If a measurement fails, decides against the new version and says why.
PromotionOutcome MeasureVersions(const PromotionTask& task, PromotionVersions& versions);

// Decides and, if so, promotes:
//   - no version of the model serves, and the criteria name no rival: promotes without a
//     measurement;
//   - no version serves: promotes if the report of the new version shows what the criteria require
//     beside rivals;
//   - otherwise compares the reports of the new version and of the serving one; promotes if no
//     metric is worse by more than its tolerance, and what is required beside rivals is met;
//   - if another version has come to serve meanwhile, compares with that one.
// Measures versions that have no report by the criteria. After MeasureVersions, that can only be a
// version that has come to serve since. A remembered decision that still holds is carried out as it
// is. If anything fails, or other versions come to serve five times, decides against the version
// and says why. If the store cannot be reached, or a measurement is interrupted, returns that
// instead.
PromotionOutcome DecidePromotion(const PromotionTask& task, PromotionVersions& versions);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROMOTION_H_
