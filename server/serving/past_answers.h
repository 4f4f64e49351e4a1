// Keeps what the last predictions said, so that they can be scored once it is known what happened.

#ifndef MANEUVER_SERVER_SERVING_PAST_ANSWERS_H_
#define MANEUVER_SERVER_SERVING_PAST_ANSWERS_H_

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"
#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/inference/action_model.h"
#include "model/scene/pose2.h"
#include "server/monitoring/metrics.h"
#include "server/security/resource_name.h"
#include "server/serving/prediction_call.h"

namespace maneuver::serving {

// What was predicted for one target. With its model, the encoding gives the whole answer again.
struct PastAnswer {
  std::string scenario_id;
  int64_t target_id = 0;
  double prediction_time = 0.0;  // seconds on the scenario's clock
  security::ModelVersionName version;
  inference::SceneEncoding encoding;
  scene::Pose2 X_WT;
  v1::AgentType type = v1::AGENT_TYPE_UNSPECIFIED;
  v1::AgentState last;   // the target's latest state at or before the prediction time
  double speed = 0.0;    // of that state, m/s (evaluation::MotionAt)
  int agents = 0;        // of the scenario at the prediction time (evaluation::AgentsAt)
  int map_features = 0;  // near the target (evaluation::MapFeaturesNear)
};

// Makes past answers of one version, scenario by scenario.
class PastAnswerMaker {
 public:
  //   spec: of the version; must outlive the result
  PastAnswerMaker(security::ModelVersionName version, const v1::ModelSpec& spec)
      : version_(std::move(version)), spec_(spec) {}

  // Returns what has to be kept of an answer. Counts the agents once for successive targets of one
  // scenario.
  //   target: as PlanPrediction made it; it has a state at the prediction time.
  PastAnswer Make(const Target& target, const inference::SceneEncoding& encoding);

 private:
  const security::ModelVersionName version_;
  const v1::ModelSpec& spec_;
  const v1::Scenario* counted_ = nullptr;
  int agents_ = 0;  // of counted_
};

// Keeps answers within a limit of memory: drops and counts the oldest ones to make room. Safe to
// use from any thread.
class PastAnswers {
 public:
  //   max_bytes: of all answers together
  PastAnswers(int64_t max_bytes, monitoring::MetricRegistry& metrics);

  // Keeps an answer, in place of one of the same version for the same scenario, target and time.
  // Does not keep one without a scenario id: nobody could name it.
  void Keep(PastAnswer answer);

  // Returns the answer; nullptr if it is not kept.
  //   version: the version that answered; without it, the latest answer of any version is returned
  std::shared_ptr<const PastAnswer> Find(
      const std::string& scenario_id, int64_t target_id, double prediction_time,
      const std::optional<security::ModelVersionName>& version) const;

  // Removes an answer that Find returned. Returns false if it is gone already.
  bool Remove(const PastAnswer& answer);

 private:
  // Scenario, target, time, version.
  using Key = std::tuple<std::string, int64_t, double, security::ModelVersionName>;
  struct Kept {
    std::shared_ptr<const PastAnswer> answer;
    int64_t bytes = 0;
    uint64_t number = 0;  // counts the answers
  };
  using Age = std::list<Kept>;

  struct Metrics {
    explicit Metrics(monitoring::MetricRegistry& registry);
    monitoring::Gauge& answers;
    monitoring::Gauge& bytes;
    monitoring::Gauge& limit;
    monitoring::Counter& dropped;
  };

  static Key KeyOf(const PastAnswer& answer);
  void RemoveLocked(Age::iterator kept) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ShowLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const int64_t max_bytes_;
  Metrics metrics_;
  mutable Mutex mutex_;
  Age by_age_ ABSL_GUARDED_BY(mutex_);  // oldest first
  std::map<Key, Age::iterator> by_key_ ABSL_GUARDED_BY(mutex_);
  int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t counted_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_PAST_ANSWERS_H_
