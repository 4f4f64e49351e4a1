// Shows on the metrics page how good predictions were, by model version and by the speed of the
// target.

#ifndef MANEUVER_SERVER_SERVING_OUTCOME_METRICS_H_
#define MANEUVER_SERVER_SERVING_OUTCOME_METRICS_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "server/monitoring/metrics.h"
#include "server/security/resource_name.h"
#include "server/serving/outcome_scoring.h"
#include "server/serving/served_model.h"

namespace maneuver::serving {

// Safe to use from any thread.
class OutcomeMetrics {
 public:
  // Versions that get metrics of their own. Later ones share the label "_others", without the
  // shares of actions, which mean something else in each model.
  static constexpr size_t kMostVersions = 32;

  // `metrics` must outlive the result.
  explicit OutcomeMetrics(monitoring::MetricRegistry& metrics);

  // Counts an outcome that was scored.
  void Observe(const ServedModel& model, const ScoredOutcome& outcome);
  // Counts a target whose outcome could not be scored: as unknown for NOT_FOUND and
  // FAILED_PRECONDITION, as invalid for INVALID_ARGUMENT, and as failed for any other error.
  void CountFailed(const absl::Status& status);

 private:
  struct Stratum {
    Stratum(monitoring::MetricRegistry& metrics, const std::string& version,
            const std::string& speed);
    monitoring::Counter& outcomes;
    std::vector<monitoring::Histogram*> histograms;  // of the first metrics of kOutcomeMetrics
    std::vector<monitoring::Counter*> covered;       // of the others
  };
  // Outcomes whose likeliest action has a p(y|s) within one of ten equal intervals.
  struct ConfidenceBin {
    ConfidenceBin(monitoring::MetricRegistry& metrics, const std::string& version, size_t bin);
    monitoring::Counter& outcomes;
    monitoring::Counter& probability;     // sum of p(y|s) of the likeliest action
    monitoring::Counter& responsibility;  // sum of q(y|x,s) of the same action
  };
  struct Version {
    std::string label;
    std::vector<ConfidenceBin> confidence;
    std::map<std::string_view, Stratum> strata;  // by speed
    std::vector<monitoring::Counter*> actions;   // [K]; empty for "_others"
    // Inputs outside of the manifest's ranges, as InputFigures() has them; empty without ranges and
    // for "_others".
    std::vector<monitoring::Counter*> outside;
  };

  // Returns the metrics of a version, which are made with its first outcome.
  Version& VersionOf(const ServedModel& model) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  monitoring::MetricRegistry& metrics_;
  monitoring::Counter& scored_;
  monitoring::Counter& unknown_;
  monitoring::Counter& invalid_;
  monitoring::Counter& failed_;
  Mutex mutex_;
  std::map<std::string, Version> versions_ ABSL_GUARDED_BY(mutex_);  // by label
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_OUTCOME_METRICS_H_
