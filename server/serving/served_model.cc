#include "server/serving/served_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "model/evaluation/action_names.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {

using security::ModelVersionName;

Engine::Engine(const inference::ActionModel& model)
    : reader_(model.spec()), session_(model.NewSession()) {}

scene::SceneInputs& Engine::Inputs(size_t i) {
  while (inputs_.size() <= i) inputs_.push_back(reader_.NewInputs());
  return inputs_[i];
}

ServedModel::ServedModel(ModelVersionName name, std::shared_ptr<const inference::ActionModel> model)
    : name_(std::move(name)),
      model_(std::move(model)),
      action_names_(std::make_shared<const std::vector<std::string>>(
          evaluation::DisplayNames(model_->manifest()))) {}

ServedModel::ActionNames ServedModel::action_names() const {
  const MutexLock lock(mutex_);
  return action_names_;
}

void ServedModel::SetActionNames(std::vector<std::string> names) {
  auto replaced = std::make_shared<const std::vector<std::string>>(std::move(names));
  const MutexLock lock(mutex_);
  action_names_ = std::move(replaced);
}

absl::Status ServedModel::WarmUp() {
  absl::Status status;
  const absl::Status ran =
      Lease(*this).With([&](Engine& engine) { status = CheckEmptyScene(engine); });
  return ran.ok() ? status : ran;
}

absl::Status ServedModel::EngineFailed(const ModelVersionName& name, const std::exception& error) {
  return errors::WithReason(
      absl::InternalError(absl::StrCat("the engine of ", name.ToString(), " failed: ", error.what(),
                                       "; try again, with fewer targets if memory is short")),
      "ENGINE_FAILED");
}

absl::Status ServedModel::CheckEmptyScene(Engine& engine) const {
  const v1::Scenario empty;
  engine.reader().Read(empty, scene::RoadMap::Over(empty.map_features()), /*time=*/0.0,
                       /*target_id=*/0, scene::Pose2(), &engine.Inputs(0));
  const std::array<inference::SceneInputsView, 1> scenes = {inference::ViewOf(engine.Inputs(0))};
  std::array<inference::SceneEncoding, 1> encodings;
  engine.session().Encode(scenes, encodings);

  const Eigen::VectorXd& probabilities = encodings[0].probabilities;
  constexpr double kSumTolerance = 1e-5;
  if (probabilities.size() != model_->spec().actions() || !probabilities.allFinite() ||
      std::abs(probabilities.sum() - 1.0) > kSumTolerance) {
    return absl::InternalError(
        absl::StrCat(name_.ToString(), " gives an empty scene no probabilities that sum to 1"));
  }
  std::vector<int> actions(static_cast<size_t>(model_->spec().actions()));
  std::iota(actions.begin(), actions.end(), 0);
  for (const inference::ActionDistribution& action :
       engine.session().Describe(encodings[0], actions, inference::LatentSource::kPosterior)) {
    if (action.sigma.empty() || !action.mean().allFinite() ||
        !action.moment_covariance.allFinite()) {
      return absl::InternalError(absl::StrCat(name_.ToString(), " gives action ", action.action,
                                              " a trajectory that is not finite"));
    }
  }
  return absl::OkStatus();
}

std::unique_ptr<Engine> ServedModel::TakeEngine() {
  {
    const MutexLock lock(mutex_);
    if (!idle_.empty()) {
      auto engine = std::move(idle_.back());
      idle_.pop_back();
      return engine;
    }
  }
  return std::make_unique<Engine>(*model_);
}

void ServedModel::ReturnEngine(std::unique_ptr<Engine> engine) {
  const MutexLock lock(mutex_);
  idle_.push_back(std::move(engine));
}

}  // namespace maneuver::serving
