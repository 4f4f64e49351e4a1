// Whether a new version becomes the one that serves: PROMOTION_IF_NO_WORSE.

#ifndef MANEUVER_SERVER_JOBS_PROMOTION_H_
#define MANEUVER_SERVER_JOBS_PROMOTION_H_

#include <optional>
#include <string>

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

// What a decision reads and changes.
class PromotionSteps {
 public:
  struct MeasuredVersion {
    absl::Status status;
    // Not `status`, but for no reason of its own: it is to be tried again, by another process.
    bool interrupted = false;
    v1::EvaluationReport report;  // if the status is OK, and nothing interrupted
  };

  virtual ~PromotionSteps() = default;
  // The version that serves the model; empty: none does.
  virtual std::string Serving() = 0;
  // What is kept of a version on the criteria's dataset; an error if there is nothing.
  virtual absl::StatusOr<v1::EvaluationReport> FindReport(const std::string& version) = 0;
  // Measures a version by the criteria, and keeps the report.
  virtual MeasuredVersion Measure(const std::string& version) = 0;
  // Makes a version serve as long as `before` does (empty: none); false if another one does.
  virtual absl::StatusOr<bool> Promote(const std::string& version, const std::string& before) = 0;
  // Keeps a decision over a death of the server, before it is carried out.
  virtual absl::Status Remember(const v1::PromotionDecision& decision) = 0;
  // The one that was kept last; nothing: none was.
  virtual std::optional<v1::PromotionDecision> Remembered() = 0;
};

// No decision: `interruption` says what came in between. Asked once more, all that was finished is
// not done again.
struct PromotionOutcome {
  std::optional<v1::PromotionDecision> decision;  // without its time
  absl::Status interruption;
};

// Decides and, if so, promotes:
//   - no version of the model serves, and the criteria require nothing beside rivals: promotes
//     without measuring anything;
//   - no version serves: promotes if the report of the new version meets the requirements;
//   - else compares the report of the new version with that of the one that serves; promotes if no
//     metric is worse by more than its tolerance, and the requirements are met;
//   - if another version has come to serve meanwhile, compares with that one.
// Measures what has no report by these criteria. Whatever fails on the way is a decision against
// it, which says why.
PromotionOutcome DecidePromotion(const PromotionTask& task, PromotionSteps& steps);

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_PROMOTION_H_
