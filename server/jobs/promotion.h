// Whether a new version becomes the one that serves: PROMOTION_IF_NO_WORSE.

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

// What is to be decided.
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
    // The measurement ended for no reason of its own: another process is to try again.
    bool interrupted = false;
    v1::EvaluationReport report;  // if the status is OK, and nothing interrupted
  };

  virtual ~PromotionVersions() = default;
  // Returns the version that serves the model; empty: none does.
  virtual std::string Serving() = 0;
  // Returns the report that is kept of a version on the criteria's dataset; an error if there is
  // none.
  virtual absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) = 0;
  // Measures a version by the criteria, and keeps the report.
  virtual MeasuredVersion Measure(const std::string& version) = 0;
  // Makes a version serve if `before` does (empty: if none does). Returns false if another one does.
  virtual absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) = 0;
  // Writes a decision down before it is carried out, so that it survives a death of the server.
  virtual absl::Status Remember(const v1::PromotionDecision& decision) = 0;
  // Returns the decision that was written down last, if there is one.
  virtual std::optional<v1::PromotionDecision> Remembered() = 0;
};

// Without a decision, `interruption` says what came in between; OK: nothing did, and nothing is
// decided yet. Asked again, nothing that was finished is done again.
struct PromotionOutcome {
  std::optional<v1::PromotionDecision> decision;  // without its time
  absl::Status interruption;
};

// Returns the versions that MeasureVersions has to measure: DecidePromotion would compare them now,
// and they have no report that meets the task's criteria.
std::vector<std::string> VersionsToMeasure(const PromotionTask& task, PromotionVersions& versions);

// Measures VersionsToMeasure. A measurement that fails is a decision against the new version, which
// says why.
PromotionOutcome MeasureVersions(const PromotionTask& task, PromotionVersions& versions);

// Decides and, if so, promotes:
//   - no version of the model serves, and the criteria require nothing beside rivals: promotes
//     without a measurement;
//   - no version serves: promotes if the report of the new version meets the requirements;
//   - else compares the report of the new version with that of the one that serves; promotes if no
//     metric is worse by more than its tolerance, and the requirements are met;
//   - if another version has come to serve meanwhile, compares with that one.
// Measures versions that have no report by the criteria, as after MeasureVersions only one that has
// come to serve since. Whatever fails on the way is a decision against the version, which says why.
PromotionOutcome DecidePromotion(const PromotionTask& task, PromotionVersions& versions);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROMOTION_H_
