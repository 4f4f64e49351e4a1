#include "client/cli/report_scenes.h"

#include <algorithm>
#include <memory>
#include <ostream>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_source.h"
#include "client/cli/text_format.h"
#include "client/map_reuse.h"
#include "client/observed_scenario.h"
#include "client/report/scene_choice.h"
#include "model/data/example_index.h"
#include "model/data/recording_split.h"
#include "model/evaluation/kinematic_classes.h"
#include "model/scene/target_frame.h"

namespace maneuver::cli {
namespace {

constexpr int kRecordings = 24;
constexpr int kListed = 2'000;
constexpr int kOfARecording = 12;
constexpr int kScenes = 24;
constexpr int kMeasuredActions = 6;         // what report::Measure wants
constexpr double kDrawnProbability = 0.01;  // actions that a scene shows are at least this probable
constexpr size_t kDrawnActions = 10;

// At most `most` of the elements, evenly spread, in their order.
template <typename Element>
std::vector<Element> Spread(const std::vector<Element>& all, int most) {
  const auto count = std::min(all.size(), static_cast<size_t>(most));
  std::vector<Element> spread;
  for (size_t i = 0; i < count; ++i) spread.push_back(all[i * all.size() / count]);
  return spread;
}

std::vector<double> WaypointTimes(const v1::TrajectorySpec& spec) {
  std::vector<double> times;
  for (int t = 1; t <= spec.waypoints(); ++t) {
    times.push_back(t * ToSeconds(spec.waypoint_interval()));
  }
  return times;
}

v1::AgentType TypeOf(const v1::Scenario& recording, int64_t agent_id) {
  const v1::Agent* const agent = scene::FindAgent(recording, agent_id);
  return agent == nullptr ? v1::AGENT_TYPE_UNSPECIFIED : agent->type();
}

// The recording as a question about one target at one time.
v1::Scenario Question(const report::Scene& scene) {
  v1::Scenario question = *scene.recording;
  question.set_prediction_time(scene.time);
  question.clear_target_ids();
  question.add_target_ids(scene.target_id);
  return question;
}

class SceneCollector {
 public:
  SceneCollector(const v1::ModelVersion& version, const SceneOrigin& source,
                 Environment& environment)
      : version_(version),
        source_(source),
        environment_(environment),
        maps_(environment.server_client()),
        times_(WaypointTimes(version.manifest().spec().trajectory())) {}

  absl::StatusOr<std::vector<report::Scene>> Collect() {
    const absl::StatusOr<std::vector<std::string>> ids = Recordings();
    if (!ids.ok()) return ids.status();
    absl::Status failure;
    std::vector<report::Scene> candidates;
    ProgressLine line(environment_.errors, environment_.progress_form());
    for (size_t i = 0; i < ids->size(); ++i) {
      line.Show(static_cast<double>(i) / static_cast<double>(ids->size()),
                absl::StrCat("looks at recording ", i + 1, " of ", ids->size()));
      absl::StatusOr<std::vector<report::Scene>> scenes = Examples((*ids)[i]);
      if (!scenes.ok()) {
        failure = scenes.status();
        continue;
      }
      for (report::Scene& scene : *scenes) candidates.push_back(std::move(scene));
    }
    line.Clear();
    if (candidates.empty() && !failure.ok()) return failure;
    if (candidates.empty()) {
      return absl::NotFoundError(absl::StrCat("no example was found in ", ids->size(),
                                              " recordings of ", ShortName(source_.dataset)));
    }
    std::vector<report::Scene> chosen = report::ChooseScenes(std::move(candidates), kScenes);
    for (report::Scene& scene : chosen) {
      const absl::Status status = Detail(&scene);
      if (!status.ok()) return status;
    }
    return chosen;
  }

 private:
  absl::StatusOr<std::vector<std::string>> Recordings() {
    const auto list = ListScenarios(source_.dataset, kListed, environment_);
    if (!list.ok()) return list.status();
    std::vector<std::string> ids;
    for (const v1::ScenarioSummary& scenario : list->scenarios()) {
      if (!source_.held_out ||
          data::HeldOut(scenario.scenario_id(), source_.examples.validation_share())) {
        ids.push_back(scenario.scenario_id());
      }
    }
    return Spread(ids, kRecordings);
  }

  // Measured examples of one recording.
  absl::StatusOr<std::vector<report::Scene>> Examples(const std::string& scenario_id) {
    absl::StatusOr<v1::Scenario> read = GetScenario(source_.dataset, scenario_id, environment_);
    if (!read.ok()) return read.status();
    const auto recording = std::make_shared<const v1::Scenario>(*std::move(read));
    std::vector<report::Scene> scenes;
    for (const data::Example& example : Spread(
             data::EnumerateExamples(*recording, 0, version_.manifest().spec(), source_.examples),
             kOfARecording)) {
      scenes.push_back(Describe(recording, example));
    }
    if (scenes.empty()) return scenes;
    const absl::Status status = Ask(&scenes);
    if (!status.ok()) return status;
    std::erase_if(scenes, [](const report::Scene& scene) {
      return scene.prediction.distributions().empty() || scene.responsibilities.empty();
    });
    for (report::Scene& scene : scenes) report::Measure(&scene);
    return scenes;
  }

  report::Scene Describe(const std::shared_ptr<const v1::Scenario>& recording,
                         const data::Example& example) const {
    report::Scene scene;
    scene.recording = recording;
    scene.target_id = example.target_id;
    scene.time = example.time;
    scene.X_WT = example.X_WT;
    scene.speed = 10.0 * static_cast<double>(example.motion[0]);  // MotionInputs are in 10 m/s
    const auto waypoints = static_cast<Eigen::Index>(times_.size());
    inference::Trajectory truth(waypoints, 2);
    for (Eigen::Index t = 0; t < waypoints; ++t) {
      const auto at = static_cast<size_t>(2 * t);
      truth.row(t) << example.trajectory[at], example.trajectory[at + 1];
      scene.truth.add_x(truth(t, 0));
      scene.truth.add_y(truth(t, 1));
    }
    scene.kinematic_class = evaluation::Name(
        evaluation::Classify(truth, times_, TypeOf(*recording, example.target_id)));
    return scene;
  }

  // Fills in predictions and responsibilities; those that the server does not give stay empty.
  absl::Status Ask(std::vector<report::Scene>* scenes) {
    v1::PredictRequest prediction;
    prediction.set_model(version_.name());
    prediction.set_priority(v1::PRIORITY_BULK);
    prediction.mutable_query()->set_top_k(
        std::min(kMeasuredActions, version_.manifest().spec().actions()));
    prediction.mutable_query()->set_frame(v1::FRAME_TARGET);
    prediction.mutable_query()->set_omit_sigma_trajectories(true);
    v1::ClassifyTrajectoriesRequest classification;
    classification.set_model(version_.name());
    classification.set_priority(v1::PRIORITY_BULK);
    for (const report::Scene& scene : *scenes) {
      *classification.add_scenarios() = Question(scene);
      client::StripFuture(&(*prediction.add_scenarios() = Question(scene)));
    }
    const auto predicted = maps_.Predict(std::move(prediction), environment_.call_options());
    if (!predicted.ok()) return predicted.status();
    const auto classified =
        maps_.ClassifyTrajectories(std::move(classification), environment_.call_options());
    if (!classified.ok()) return classified.status();
    // Whether an answer is about one target of a scene that was asked about.
    const auto fits = [scenes](const auto& answer) {
      return answer.targets_size() == 1 && answer.scenario_index() >= 0 &&
             static_cast<size_t>(answer.scenario_index()) < scenes->size();
    };
    for (const v1::ScenarioPrediction& answer : predicted->predictions()) {
      if (!fits(answer)) continue;
      (*scenes)[static_cast<size_t>(answer.scenario_index())].prediction = answer.targets(0);
    }
    for (const v1::ScenarioClassification& answer : classified->classifications()) {
      if (!fits(answer)) continue;
      const auto& responsibilities = answer.targets(0).responsibilities();
      (*scenes)[static_cast<size_t>(answer.scenario_index())].responsibilities.assign(
          responsibilities.begin(), responsibilities.end());
    }
    return absl::OkStatus();
  }

  // Asks for the distributions that the page draws: of the probable actions, and of the one that
  // it was.
  absl::Status Detail(report::Scene* scene) {
    v1::PredictRequest request;
    request.set_model(version_.name());
    client::StripFuture(&(*request.add_scenarios() = Question(*scene)));
    for (const int id : Drawn(*scene)) {
      request.mutable_query()->mutable_action_ids()->add_ids(id);
    }
    request.mutable_query()->set_frame(v1::FRAME_TARGET);
    request.mutable_query()->set_omit_sigma_trajectories(true);
    const auto answer = maps_.Predict(std::move(request), environment_.call_options());
    if (!answer.ok()) return answer.status();
    if (answer->predictions_size() != 1 || answer->predictions(0).targets_size() != 1) {
      return absl::InternalError("the server did not answer for the one scene that it was asked");
    }
    scene->prediction = answer->predictions(0).targets(0);
    return absl::OkStatus();
  }

  static std::set<int> Drawn(const report::Scene& scene) {
    const auto& probabilities = scene.prediction.probabilities();
    std::vector<int> ids(static_cast<size_t>(probabilities.size()));
    for (size_t i = 0; i < ids.size(); ++i) ids[i] = static_cast<int>(i);
    std::ranges::stable_sort(ids, std::ranges::greater{},
                             [&](int id) { return probabilities[id]; });
    std::erase_if(ids, [&](int id) { return probabilities[id] < kDrawnProbability; });
    if (ids.size() > kDrawnActions) ids.resize(kDrawnActions);
    std::set<int> drawn(ids.begin(), ids.end());
    const auto was = std::ranges::max_element(scene.responsibilities);
    drawn.insert(static_cast<int>(was - scene.responsibilities.begin()));
    return drawn;
  }

  const v1::ModelVersion& version_;
  const SceneOrigin& source_;
  Environment& environment_;
  client::MapReuse maps_;
  const std::vector<double> times_;  // of the waypoints, seconds
};

}  // namespace

absl::StatusOr<std::vector<report::Scene>> CollectScenes(const v1::ModelVersion& version,
                                                         const SceneOrigin& source,
                                                         Environment& environment) {
  return SceneCollector(version, source, environment).Collect();
}

}  // namespace maneuver::cli
