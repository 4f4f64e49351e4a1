// A report with something in each of its parts, and with names that try to leave the page's data.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_REPORT_MADE_UP_REPORT_H_
#define MANEUVER_TESTS_UNIT_CLIENT_REPORT_MADE_UP_REPORT_H_

#include <cmath>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "client/report/report_data.h"

namespace maneuver::report {

inline constexpr char kHostile[] = "</script><script>window.broken = true</script><img src=x>";
inline constexpr int kMadeUpActions = 7;
inline constexpr int kMadeUpWaypoints = 10;  // every half second

// An arc that ends `ahead` metres in front and `left` metres to the left.
inline v1::Trajectory Arc(double ahead, double left) {
  v1::Trajectory arc;
  for (int t = 1; t <= kMadeUpWaypoints; ++t) {
    const double share = static_cast<double>(t) / kMadeUpWaypoints;
    arc.add_x(share * ahead);
    arc.add_y(share * share * left);
  }
  return arc;
}

inline v1::ActionDistribution MadeUpDistribution(int id, double probability, double speed) {
  v1::ActionDistribution action;
  action.set_action_id(id);
  action.set_probability(probability);
  const double ahead = 5.0 * speed - 4.0 * id;
  const double left = id % 2 == 0 ? 3.0 * id : -3.0 * id;
  *action.mutable_mean_trajectory() = Arc(ahead, left);
  for (const double sign : {1.0, -1.0}) {
    *action.add_sigma_trajectories() = Arc(ahead + 3.0 * sign, left + sign);
  }
  for (int t = 1; t <= kMadeUpWaypoints; ++t) {
    action.mutable_moments()->add_mean_x(action.mean_trajectory().x(t - 1));
    action.mutable_moments()->add_mean_y(action.mean_trajectory().y(t - 1));
    action.mutable_moments()->add_covariance_xx(0.05 * t * t);
    action.mutable_moments()->add_covariance_xy(0.005 * t * t);
    action.mutable_moments()->add_covariance_yy(0.02 * t * t);
  }
  return action;
}

inline v1::ActionSet MadeUpActionSet(double speed) {
  v1::ActionSet set;
  set.set_model_version("models/town/versions/3");
  set.set_speed(speed);
  for (int t = 1; t <= kMadeUpWaypoints; ++t) set.add_waypoint_times(0.5 * t);
  for (int id = 0; id < kMadeUpActions; ++id) {
    v1::Action* action = set.add_actions();
    action->set_action_id(id);
    action->set_derived_name(absl::StrCat("turn number ", id));
    if (id == 2) action->set_display_name(kHostile);
    action->set_usage(0.4 / (id + 1));
    action->set_effective(id < kMadeUpActions - 1);
    *action->mutable_distribution() = MadeUpDistribution(id, action->usage(), speed);
  }
  return set;
}

inline std::shared_ptr<const v1::Scenario> MadeUpRecording(const std::string& id) {
  auto recording = std::make_shared<v1::Scenario>();
  recording->set_scenario_id(id);
  for (const double y : {-4.0, 0.0, 4.0}) {
    v1::MapFeature* lane = recording->add_map_features();
    lane->set_id(static_cast<int64_t>(10 + y));
    lane->set_type(y == 0.0 ? v1::MAP_FEATURE_TYPE_LANE_CENTERLINE
                            : v1::MAP_FEATURE_TYPE_ROAD_EDGE);
    for (int i = -40; i <= 120; ++i) {
      lane->add_x(i);
      lane->add_y(y);
    }
  }
  v1::MapFeature* crossing = recording->add_map_features();
  crossing->set_type(v1::MAP_FEATURE_TYPE_CROSSWALK);
  for (const auto& [x, y] : {std::pair{30.0, -4.0}, {34.0, -4.0}, {34.0, 4.0}, {30.0, 4.0}}) {
    crossing->add_x(x);
    crossing->add_y(y);
  }
  v1::TrafficSignal* signal = recording->add_traffic_signals();
  signal->set_lane_id(10);
  v1::TrafficSignalReading* reading = signal->add_readings();
  reading->set_time(0.0);
  reading->set_state(v1::TRAFFIC_SIGNAL_STATE_GO);
  for (const int64_t agent_id : {int64_t{7}, int64_t{9007199254740993}}) {  // the second: 2^53 + 1
    v1::Agent* agent = recording->add_agents();
    agent->set_id(agent_id);
    agent->set_type(v1::AGENT_TYPE_VEHICLE);
    agent->set_length(4.6);
    agent->set_width(1.9);
    for (int i = 0; i <= 80; ++i) {
      v1::AgentState* state = agent->add_states();
      state->set_time(0.1 * i);
      state->set_x(agent_id == 7 ? i - 20.0 : 25.0);
      state->set_velocity_x(agent_id == 7 ? 10.0F : 0.0F);
      state->set_y(agent_id == 7 ? 0.0 : -4.0);
    }
  }
  return recording;
}

inline Scene MadeUpScene(int number, const std::string& group) {
  Scene scene;
  scene.recording = MadeUpRecording(number == 1 ? kHostile : absl::StrCat("recording ", number));
  scene.target_id = 7;
  scene.time = 2.0;
  scene.X_WT = scene::Pose2(0.0, 0.0, 0.0);
  scene.speed = 10.0;
  scene.truth = Arc(48.0 - number, 2.0 * number);
  scene.kinematic_class = number % 2 == 0 ? "straight_fast" : "left_turn";
  scene.prediction.set_target_id(7);
  double left = 1.0;
  for (int id = 0; id < kMadeUpActions; ++id) {
    const double p = id + 1 == kMadeUpActions ? left : 0.5 * left;
    left -= p;
    scene.prediction.add_probabilities(p);
    scene.responsibilities.push_back(id == number % kMadeUpActions ? 1.0 : 0.0);
    *scene.prediction.add_distributions() = MadeUpDistribution(id, p, 10.0);
  }
  scene.ade_1 = 0.5 * number;
  scene.min_ade_6 = 0.25 * number;
  scene.surprise = 0.7 * number;
  scene.groups = {group};
  return scene;
}

inline v1::EvaluationReport MadeUpEvaluation() {
  v1::EvaluationReport report;
  report.set_model_version("models/town/versions/3");
  report.set_dataset("datasets/unseen");
  report.set_examples(1'200);
  auto& metrics = *report.mutable_metrics();
  metrics["ade_1"] = 1.25;
  metrics["ade_cv"] = 3.5;
  metrics["min_ade_6"] = 0.5;
  metrics["miss_rate_6"] = 0.125;
  metrics["nll"] = 0.75;
  metrics["coverage_2sigma"] = 0.84;
  metrics["calibration_error"] = 0.03;
  metrics["effective_actions"] = 6.0;
  for (int i = 0; i < 10; ++i) {
    v1::ReliabilityBin* bin = report.add_reliability();
    bin->set_lower(0.1 * i);
    bin->set_upper(0.1 * (i + 1));
    bin->set_examples(10 * i);
    bin->set_mean_confidence(0.1 * i + 0.05);
    bin->set_mean_responsibility(0.09 * i + 0.05);
  }
  for (int id = 0; id < kMadeUpActions; ++id) {
    v1::ActionUse* use = report.add_action_uses();
    use->set_probability(0.4 / (id + 1));
    use->set_examples(100 * id);
    use->set_kinematic_class("left_turn");
    use->set_class_share(0.5);
  }
  v1::EvaluationStratum* stratum = report.add_strata();
  stratum->set_dimension("speed");
  stratum->set_name("5-10 m/s");
  stratum->set_examples(300);
  *stratum->mutable_metrics() = metrics;
  report.mutable_rivals()->set_recordings(40);
  report.mutable_rivals()->set_groups(40);
  for (const char* part : {"", "5-10 m/s"}) {
    v1::RivalStanding* standing = report.mutable_rivals()->add_parts();
    standing->set_name(part);
    if (*part != '\0') standing->set_dimension("speed");
    standing->set_examples(300);
    for (const char* rival : {"cv", "ctra", "faded"}) {  // wider than a phone
      v1::RivalComparison* comparison = standing->add_comparisons();
      comparison->set_metric("ade_1");
      comparison->set_rival(rival);
      comparison->mutable_difference()->set_value(-2.25);
      comparison->mutable_difference()->set_lower(-2.5);
      comparison->mutable_difference()->set_upper(-2.0);
      comparison->set_verdict(v1::RIVAL_VERDICT_AHEAD);
    }
  }
  return report;
}

inline v1::JobProgress MadeUpEpoch(const std::string& phase, int epoch, int64_t step) {
  v1::JobProgress progress;
  progress.set_sequence(step);
  progress.mutable_time()->set_seconds(1'700'000'000 + step);
  progress.set_phase(phase);
  progress.set_epoch(epoch);
  progress.set_step(step);
  auto& report = *progress.mutable_epoch_report();
  (*report.mutable_training())["loss"] = 4.0 / epoch;
  (*report.mutable_training())["divergence"] = 0.5 / epoch;
  (*report.mutable_validation())["loss"] = 4.5 / epoch;
  if (phase == "joint") {
    report.add_action_usage(1.0);
    report.set_effective_actions(epoch + 3);
  }
  return progress;
}

inline ReportData MadeUpReport() {
  ReportData data;
  data.title = "town/3";
  data.made = "2026-02-03 14:05";
  data.program = "maneuver 0.1.0";
  v1::ModelVersion version;
  version.set_name("models/town/versions/3");
  version.add_aliases("serving");
  v1::Provenance* provenance = version.mutable_manifest()->mutable_provenance();
  provenance->add_datasets("town");
  provenance->mutable_settings()->set_preset("lanes");
  provenance->mutable_settings()->mutable_optimization()->set_batch_size(64);
  data.version = version;
  for (const double speed : {0.0, 10.0}) data.action_sets.push_back(MadeUpActionSet(speed));
  data.evaluation = MadeUpEvaluation();
  v1::EvaluationReport other = MadeUpEvaluation();
  other.set_model_version("models/town/versions/2");
  (*other.mutable_metrics())["ade_1"] = 1.5;
  data.others.push_back(other);
  std::vector<v1::JobProgress> events;
  for (int epoch = 1; epoch <= 3; ++epoch) events.push_back(MadeUpEpoch("pretrain", epoch, epoch));
  for (int epoch = 1; epoch <= 5; ++epoch) {
    events.push_back(MadeUpEpoch("joint", epoch, 3 + epoch));
  }
  data.learning = LearningPhases(events);
  data.scenes_from = "datasets/unseen";
  data.scenes = {MadeUpScene(0, "best"), MadeUpScene(1, "worst"), MadeUpScene(2, "surprising")};
  return data;
}

}  // namespace maneuver::report

#endif  // MANEUVER_TESTS_UNIT_CLIENT_REPORT_MADE_UP_REPORT_H_
