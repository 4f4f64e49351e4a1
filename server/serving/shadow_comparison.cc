#include "server/serving/shadow_comparison.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "maneuver/v1/scenario.pb.h"
#include "model/artifact/model_spec.h"
#include "model/scene/observation_window.h"
#include "model/scene/target_frame.h"

namespace maneuver::serving {
namespace {

evaluation::VersionAnswer AnswerOf(inference::InferenceSession& session,
                                   const inference::SceneEncoding& encoding) {
  const Eigen::VectorXd& p = encoding.probabilities;
  const AtLeast likely{std::min(ShadowComparison::kLeastProbability, p.maxCoeff())};
  return {
      p, session.Describe(encoding, SelectActions(p, likely), inference::LatentSource::kPosterior)};
}

bool IsFinite(const evaluation::AnswerDifference& difference) {
  return std::isfinite(difference.expected) && std::isfinite(difference.likeliest) &&
         std::isfinite(difference.energy) && std::isfinite(difference.first_entropy) &&
         std::isfinite(difference.second_entropy) &&
         std::isfinite(difference.divergence.value_or(0.0));
}

}  // namespace

absl::StatusOr<std::unique_ptr<ShadowComparison>> ShadowComparison::Make(ModelHandle answered,
                                                                         ModelHandle candidate) {
  auto comparison = evaluation::AnswerComparison::Make(answered->model().manifest(),
                                                       candidate->model().manifest());
  if (!comparison.ok()) return comparison.status();
  return std::unique_ptr<ShadowComparison>(
      new ShadowComparison(std::move(answered), std::move(candidate), *std::move(comparison)));
}

ShadowComparison::ShadowComparison(ModelHandle answered, ModelHandle candidate,
                                   evaluation::AnswerComparison comparison)
    : answered_(std::move(answered)),
      candidate_(std::move(candidate)),
      comparison_(std::move(comparison)),
      answered_session_(answered_->model().NewSession()),
      candidate_engine_(candidate_->model()) {}

absl::Status ShadowComparison::Read(const Target& target) {
  const v1::Scenario& scenario = *target.scenario;
  const double tolerance = scene::WindowOf(candidate_->model().spec()).tolerance();
  const v1::Agent* agent = scene::FindAgent(scenario, target.id);
  if (agent == nullptr ||
      !scene::TargetPose(*agent, scenario.prediction_time(), tolerance).has_value()) {
    return absl::FailedPreconditionError("the candidate sees no state of the target");
  }
  if (!artifact::Predicts(candidate_->model().spec(), agent->type())) {
    return absl::FailedPreconditionError("the candidate has not learned the target's type");
  }
  ReadScene(target, candidate_engine_.reader(), &candidate_engine_.Inputs(0));
  return absl::OkStatus();
}

absl::Status ShadowComparison::Encode() {
  const std::array<inference::SceneInputsView, 1> scene = {
      inference::ViewOf(candidate_engine_.Inputs(0))};
  candidate_engine_.session().Encode(scene, {&candidate_encoding_, 1});
  if (candidate_encoding_.probabilities.allFinite()) return absl::OkStatus();
  return absl::InternalError("the candidate's probabilities are not numbers");
}

absl::StatusOr<evaluation::AnswerDifference> ShadowComparison::Compare(
    const inference::SceneEncoding& answered) {
  const auto difference =
      comparison_.Compare(AnswerOf(*answered_session_, answered),
                          AnswerOf(candidate_engine_.session(), candidate_encoding_));
  if (!IsFinite(difference)) return absl::InternalError("the versions' difference is not a number");
  return difference;
}

}  // namespace maneuver::serving
