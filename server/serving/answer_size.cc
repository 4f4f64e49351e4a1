#include "server/serving/answer_size.h"

#include <algorithm>
#include <cmath>

namespace maneuver::serving {
namespace {

// Tag and length of a field.
constexpr int64_t kField = 8;

int64_t Numbers(int64_t count) { return 8 * count + kField; }

int64_t MostActions(const DescribeActions& question, int actions) {
  int64_t most = actions;
  if (const auto* chosen = std::get_if<ActionIds>(&question.selection)) {
    most = static_cast<int64_t>(chosen->ids.size());
  } else if (const auto* top = std::get_if<TopK>(&question.selection)) {
    most = top->k;
  } else if (const auto* least = std::get_if<AtLeast>(&question.selection)) {
    // A hair more, for rounding.
    if (least->probability > 0.0) {
      most = static_cast<int64_t>(std::min(1e9, 1.0 / least->probability + 1e-6));
    }
  }
  // Combinations share their actions.
  const auto combined =
      std::min<int64_t>(question.combinations, int64_t{inference::kMostJointActions});
  return std::min<int64_t>(most + question.representatives + combined, actions);
}

}  // namespace

int64_t MostBytesOfTarget(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories) {
  const int64_t probabilities = Numbers(spec.actions());
  const auto* describe = std::get_if<DescribeActions>(&question);
  if (describe == nullptr) return std::max(kTargetErrorBytes, 2 * probabilities + 8 * kField);
  const int64_t latents = spec.latent_dimensions();
  const int64_t waypoints = spec.trajectory().waypoints();
  const int64_t trajectory = 2 * Numbers(waypoints) + kField;
  const int64_t trajectories = 1 + (sigma_trajectories ? 2 * latents + 1 : 0);
  const int64_t moments = 5 * Numbers(waypoints) + kField;
  const int64_t distribution =
      2 * Numbers(latents) + trajectories * trajectory + moments + 4 * kField;
  const int64_t representatives = int64_t{describe->representatives} * 3 * kField;
  // Its id beside the combinations, and its action in each of them.
  const int64_t joint = int64_t{describe->combinations} * kField + 2 * kField;
  return std::max(kTargetErrorBytes, probabilities + representatives + joint + 4 * kField +
                                         MostActions(*describe, spec.actions()) * distribution);
}

int64_t MostBytesOfAnswer(const v1::ModelSpec& spec, const Question& question,
                          bool sigma_trajectories, int scenarios, int targets) {
  const auto* describe = std::get_if<DescribeActions>(&question);
  const int64_t combinations = describe == nullptr ? 0 : describe->combinations;
  return scenarios * (kScenarioBytes + combinations * 5 * kField) +
         targets * MostBytesOfTarget(spec, question, sigma_trajectories);
}

}  // namespace maneuver::serving
