#include "server/serving/outcome_scoring.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/data/example_index.h"
#include "model/data/trajectory.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/strata.h"
#include "model/scene/observation_window.h"
#include "model/scene/scenario_validation.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

// No road user is faster, m/s. Anything above it is an error of tracking.
constexpr double kMostSpeed = 100.0;

// Returns the metrics of kOutcomeMetrics, in their order.
std::vector<evaluation::ExampleMetric> OutcomeMetricList() {
  const auto all = evaluation::ExampleMetrics(/*measured_by_waymo=*/false,
                                              /*with_baselines=*/false);
  std::vector<evaluation::ExampleMetric> chosen;
  for (const std::string_view name : kOutcomeMetrics) {
    chosen.push_back(*std::ranges::find(all, name, &evaluation::ExampleMetric::name));
  }
  return chosen;
}

std::string_view SpeedStratum(const evaluation::StratumKeys& keys) {
  const auto& all = evaluation::Stratifications();
  const auto* const speed = std::ranges::find(all, "speed", &evaluation::Stratification::dimension);
  return speed->names[static_cast<size_t>(speed->stratum(keys))];
}

// Checks the states as those of an agent in a scenario.
absl::Status CheckStates(const AgentStates& states, const std::string& path) {
  v1::Scenario scenario;
  v1::Agent& agent = *scenario.add_agents();
  agent.set_length(1.0);
  agent.set_width(1.0);
  *agent.mutable_states() = states;
  std::vector<scene::FieldViolation> violations = scene::ValidateScenario(scenario, {});
  constexpr std::string_view kAgent = "agents[0].";
  for (scene::FieldViolation& violation : violations) violation.field.erase(0, kAgent.size());
  return violations.empty() ? absl::OkStatus() : errors::InvalidFields(violations, path);
}

// Checks that the target can have moved from its last state through these.
absl::Status CheckMotion(const PastAnswer& answer, const AgentStates& states,
                         const std::string& path) {
  if (states.empty()) return errors::InvalidField(absl::StrCat(path, ".states"), "is empty");
  const double begin = std::max(answer.prediction_time, answer.last.time());
  if (!(states[0].time() > begin)) {
    return errors::InvalidField(absl::StrCat(path, ".states[0].time"),
                                "is not after the prediction time");
  }
  const double fastest = std::min(kMostSpeed, data::MostSpeed(answer.type));
  const v1::AgentState* before = &answer.last;
  for (int i = 0; i < states.size(); ++i) {
    const v1::AgentState& after = states[i];
    const double distance = std::hypot(after.x() - before->x(), after.y() - before->y());
    if (distance > fastest * (after.time() - before->time())) {
      return errors::InvalidField(
          absl::StrCat(path, ".states[", i, "]"),
          absl::StrCat("is ", distance, " m from the state before it; ",
                       artifact::AgentText(answer.type), " moves at most ", fastest, " m/s"));
    }
    before = &after;
  }
  return absl::OkStatus();
}

absl::StatusOr<evaluation::Trajectory> TrajectoryOf(const PastAnswer& answer,
                                                    const AgentStates& states,
                                                    const v1::ModelSpec& spec,
                                                    const std::string& path) {
  v1::Agent track;
  *track.add_states() = answer.last;
  track.mutable_states()->MergeFrom(states);
  const std::vector<double> times = artifact::WaypointTimes(spec.trajectory());
  evaluation::Trajectory trajectory(static_cast<Eigen::Index>(times.size()), 2);
  int missing = 0;
  if (!data::ResampleFuture(
          track, answer.prediction_time, answer.X_WT, times, scene::WindowOf(spec).max_gap(),
          {trajectory.data(), static_cast<size_t>(trajectory.size())}, &missing)) {
    return errors::InvalidField(
        absl::StrCat(path, ".states"),
        absl::StrCat("no states around ", times[static_cast<size_t>(missing)],
                     " s after the prediction time; an outcome needs the ", times.back(),
                     " s that the model looks ahead, without gaps"));
  }
  return trajectory;
}

}  // namespace

absl::StatusOr<ScoredOutcome> ScoreOutcome(const PastAnswer& answer, const AgentStates& states,
                                           const inference::ActionModel& model,
                                           inference::InferenceSession& session,
                                           const std::string& path) {
  if (auto status = CheckStates(states, path); !status.ok()) return status;
  if (auto status = CheckMotion(answer, states, path); !status.ok()) return status;
  const auto trajectory = TrajectoryOf(answer, states, model.spec(), path);
  if (!trajectory.ok()) return trajectory.status();
  ScoredOutcome scored;
  evaluation::MeasureAnswer(answer.encoding, *trajectory, session, &scored.measurement);
  scored.measurement.keys.speed = answer.speed;
  scored.measurement.keys.agents = answer.agents;
  scored.measurement.keys.map_features = answer.map_features;
  scored.speed_stratum = SpeedStratum(scored.measurement.keys);
  static const auto* const kMetrics =
      new std::vector<evaluation::ExampleMetric>(OutcomeMetricList());
  bool finite = scored.measurement.responsibilities.allFinite();
  for (size_t i = 0; i < kMetrics->size(); ++i) {
    scored.metrics[i] = (*kMetrics)[i].value(scored.measurement);
    finite = finite && std::isfinite(scored.metrics[i]);
  }
  if (finite) return scored;
  return errors::WithReason(
      absl::InternalError(absl::StrCat(path, ": the model's answer gives no finite score")),
      "ANSWER_UNSOUND");
}

}  // namespace maneuver::serving
