#include "client/cli/figures.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <filesystem>
#include <ostream>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/action_gallery.h"
#include "client/cli/command.h"
#include "client/cli/json_files.h"
#include "client/cli/scenario_source.h"
#include "client/observed_scenario.h"
#include "client/plot/action_means_plot.h"
#include "client/plot/action_set_plot.h"
#include "client/plot/posterior_plot.h"
#include "client/plot/reliability_plot.h"

namespace maneuver::cli {
namespace {

// A scene worth looking at, and the name of its figure.
using ChosenScene = std::pair<std::string, const v1::EvaluatedExample*>;

double Entropy(const v1::EvaluatedExample& example) {
  double entropy = 0.0;
  for (const double p : example.probabilities()) entropy -= p > 0.0 ? p * std::log(p) : 0.0;
  return entropy;
}

std::vector<ChosenScene> ChooseScenes(const v1::EvaluationReport& report) {
  const auto end_y = [](const v1::EvaluatedExample& example) {
    return example.trajectory().y().empty() ? 0.0 : *example.trajectory().y().rbegin();
  };
  const auto end_x = [](const v1::EvaluatedExample& example) {
    return example.trajectory().x().empty() ? 0.0 : *example.trajectory().x().rbegin();
  };
  std::vector<ChosenScene> chosen;
  std::set<std::string> scenarios;  // each recording once
  const auto choose = [&](const std::string& name, auto value) {
    const v1::EvaluatedExample* best = nullptr;
    for (const v1::EvaluatedExample& example : report.sampled_examples()) {
      if (scenarios.contains(example.scenario_id())) continue;
      if (best == nullptr || value(example) > value(*best)) best = &example;
    }
    if (best == nullptr) return;
    scenarios.insert(best->scenario_id());
    chosen.emplace_back(name, best);
  };
  choose("scene-left", end_y);
  choose("scene-right", [&](const auto& example) { return -end_y(example); });
  choose("scene-far", end_x);
  choose("scene-open", Entropy);
  return chosen;
}

class Figures {
 public:
  Figures(const v1::EvaluationReport& report, const std::string& folder, Environment& environment)
      : report_(report), folder_(folder), environment_(environment) {}

  int Draw() {
    const absl::Status prepared = PrepareFigureFolder(folder_);
    if (!prepared.ok()) return environment_.Refuse(std::string(prepared.message()));
    v1::GetActionSetRequest request;
    request.set_name(report_.model_version());
    auto actions = environment_.server_client().GetActionSet(request, environment_.call_options());
    if (!actions.ok()) return environment_.FailCall(actions.status());
    actions_ = *std::move(actions);
    Save("actions", actions_.has_speed() ? DrawGallery(report_.model_version(), {}, environment_)
                                         : plot::DrawActionSet(actions_, {}));
    Save("action-means", plot::DrawActionMeans(actions_, report_));
    Save("reliability", plot::DrawReliability(report_));
    for (const auto& [name, example] : ChooseScenes(report_)) Save(name, DrawScene(*example));
    return all_well_ ? kOk : kFailed;
  }

 private:
  void Save(const std::string& name, const absl::StatusOr<std::string>& picture) {
    const std::string file = (std::filesystem::path(folder_) / (name + ".png")).string();
    const absl::Status status = picture.ok() ? WriteFile(file, *picture) : picture.status();
    if (status.ok()) {
      environment_.err << "the picture is " << file << "\n";
    } else {
      environment_.FailCall(status);
      all_well_ = false;
    }
  }

  absl::StatusOr<v1::PredictResponse> Predict(const v1::Scenario& observed,
                                              v1::LatentSource source) {
    v1::PredictRequest request;
    request.set_model(report_.model_version());
    *request.add_scenarios() = observed;
    request.mutable_query()->set_source(source);
    request.mutable_query()->set_frame(v1::FRAME_TARGET);
    return environment_.server_client().Predict(request, environment_.call_options());
  }

  absl::StatusOr<std::string> DrawScene(const v1::EvaluatedExample& example) {
    absl::StatusOr<v1::Scenario> scenario =
        GetScenario(report_.dataset(), example.scenario_id(), environment_);
    if (!scenario.ok()) return scenario.status();
    scenario->set_prediction_time(example.time());
    scenario->clear_target_ids();
    scenario->add_target_ids(example.target_id());
    v1::Scenario observed = *scenario;
    client::StripFuture(&observed);
    const auto generic = Predict(observed, v1::LATENT_SOURCE_PRIOR);
    if (!generic.ok()) return generic.status();
    const auto posterior = Predict(observed, v1::LATENT_SOURCE_POSTERIOR);
    if (!posterior.ok()) return posterior.status();
    if (generic->predictions_size() != 1 || posterior->predictions_size() != 1) {
      return absl::InternalError("the server's answer lacks the scene that was asked about");
    }
    plot::ScenePlotOptions options;
    options.frame = v1::FRAME_TARGET;
    options.model_version = report_.model_version();
    for (const v1::Action& action : actions_.actions()) {
      options.labels[action.action_id()] = action.display_name();
    }
    if (!posterior->waypoint_times().empty()) {
      options.horizon = *posterior->waypoint_times().rbegin();
    }
    return plot::DrawGenericAndPosterior(*scenario, generic->predictions(0),
                                         posterior->predictions(0), options);
  }

  const v1::EvaluationReport& report_;
  const std::string folder_;
  Environment& environment_;
  v1::ActionSet actions_;
  bool all_well_ = true;
};

}  // namespace

absl::Status PrepareFigureFolder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error && access(folder.c_str(), W_OK | X_OK) != 0) {
    error = std::error_code(errno, std::generic_category());
  }
  if (!error) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("cannot write into the folder ", folder, ": ", error.message()));
}

int DrawFigures(const v1::EvaluationReport& report, const std::string& folder,
                Environment& environment) {
  return Figures(report, folder, environment).Draw();
}

}  // namespace maneuver::cli
