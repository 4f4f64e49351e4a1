#include "model/evaluation/action_matching.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"
#include "model/evaluation/assignment.h"
#include "model/evaluation/generic_mean.h"
#include "model/evaluation/kinematic_classes.h"
#include "model/inference/trajectory_set.h"
#include "model/scene/target_frame.h"

namespace maneuver::evaluation {
namespace {

using inference::Trajectory;

// An effective action of one of the models.
struct Candidate {
  v1::MatchedAction description;
  Trajectory mean;  // generic, target frame
};

//   shares: [K]; empty: those of the manifest
absl::StatusOr<std::vector<Candidate>> CandidatesOf(const v1::ModelManifest& manifest,
                                                    const Eigen::VectorXd& shares,
                                                    std::span<const double> waypoint_times) {
  const bool of_pedestrians = manifest.spec().target_types_size() == 1 &&
                              manifest.spec().target_types(0) == v1::AGENT_TYPE_PEDESTRIAN;
  const v1::AgentType type = of_pedestrians ? v1::AGENT_TYPE_PEDESTRIAN : v1::AGENT_TYPE_VEHICLE;
  std::vector<Candidate> candidates;
  for (const v1::Action& action : manifest.actions()) {
    if (!action.effective()) continue;
    std::optional<Trajectory> mean = GenericMean(action);
    if (!mean || mean->rows() != static_cast<Eigen::Index>(waypoint_times.size())) {
      return absl::InvalidArgumentError(absl::StrCat("the mean trajectory of action ",
                                                     action.action_id(), " has not ",
                                                     waypoint_times.size(), " waypoints"));
    }
    v1::MatchedAction description;
    description.set_action_id(action.action_id());
    description.set_label(action.label());
    description.set_kinematic_class(std::string(Name(Classify(*mean, waypoint_times, type))));
    description.set_share(shares.size() == 0 ? action.usage() : shares[action.action_id()]);
    candidates.push_back({std::move(description), *std::move(mean)});
  }
  if (candidates.empty()) {
    return absl::InvalidArgumentError("a model has no effective action: there is nothing to match");
  }
  return candidates;
}

Eigen::MatrixXd DistancesOf(std::span<const Candidate> first, std::span<const Candidate> second) {
  Eigen::MatrixXd distances(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i) {
    for (size_t j = 0; j < second.size(); ++j) {
      distances(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
          (first[i].mean - second[j].mean).rowwise().norm().mean();
    }
  }
  return distances;
}

// Returns the cost of pairing i and j. Square: the smaller side is filled up with idle partners.
Eigen::MatrixXd CostsOf(std::span<const Candidate> first, std::span<const Candidate> second,
                        const Eigen::MatrixXd& distances) {
  constexpr double kLeastShare = 1e-6;  // pairs actions without a share by distance
  const auto weight = [](std::span<const Candidate> side, Eigen::Index i) {
    const bool left_over = i >= static_cast<Eigen::Index>(side.size());
    return left_over ? 0.0 : side[static_cast<size_t>(i)].description.share() + kLeastShare;
  };
  const Eigen::Index size = std::max(distances.rows(), distances.cols());
  Eigen::MatrixXd costs(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      const bool both = i < distances.rows() && j < distances.cols();
      costs(i, j) = (weight(first, i) + weight(second, j)) / 2.0 *
                    (both ? distances(i, j) : distances.maxCoeff());
    }
  }
  return costs;
}

void AddPairs(std::span<const Candidate> first, std::span<const Candidate> second,
              v1::ActionMatching& matching) {
  const Eigen::MatrixXd distances = DistancesOf(first, second);
  const std::vector<int> partners = LeastCostAssignment(CostsOf(first, second, distances));
  std::vector<v1::ActionPair> pairs;
  std::set<int> taken;
  for (size_t i = 0; i < first.size(); ++i) {
    if (partners[i] >= distances.cols()) {
      *matching.add_unpaired_first() = first[i].description;
      continue;
    }
    taken.insert(partners[i]);
    v1::ActionPair& pair = pairs.emplace_back();
    *pair.mutable_first() = first[i].description;
    *pair.mutable_second() = second[static_cast<size_t>(partners[i])].description;
    pair.set_distance(distances(static_cast<Eigen::Index>(i), partners[i]));
  }
  for (size_t j = 0; j < second.size(); ++j) {
    if (!taken.contains(static_cast<int>(j))) {
      *matching.add_unpaired_second() = second[j].description;
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const auto& a, const auto& b) { return a.distance() < b.distance(); });
  matching.mutable_pairs()->Add(pairs.begin(), pairs.end());
}

void AddAgreement(v1::ActionMatching& matching) {
  double distance = 0.0;
  double weight = 0.0;
  double first = 0.0;
  double second = 0.0;
  for (const v1::ActionPair& pair : matching.pairs()) {
    const double shares = (pair.first().share() + pair.second().share()) / 2.0;
    distance += shares * pair.distance();
    weight += shares;
    if (pair.distance() > matching.tolerance()) continue;
    first += pair.first().share();
    second += pair.second().share();
  }
  if (weight > 0.0) matching.set_mean_distance(distance / weight);
  matching.set_agreeing_share_first(first);
  matching.set_agreeing_share_second(second);
}

}  // namespace

absl::StatusOr<v1::ActionMatching> MatchActions(const v1::ModelManifest& first,
                                                const Eigen::VectorXd& first_shares,
                                                const v1::ModelManifest& second,
                                                const Eigen::VectorXd& second_shares) {
  const std::vector<double> times = artifact::WaypointTimes(first.spec().trajectory());
  const std::vector<double> others = artifact::WaypointTimes(second.spec().trajectory());
  const bool alike =
      std::equal(times.begin(), times.end(), others.begin(), others.end(),
                 [](double a, double b) { return std::abs(a - b) < scene::kSameTime; });
  if (!alike || times.empty()) {
    return absl::InvalidArgumentError(
        "the models' waypoints are not at the same times: match models of one horizon and one "
        "waypoint interval");
  }
  if (artifact::HasReference(first.spec()) != artifact::HasReference(second.spec())) {
    return absl::InvalidArgumentError(
        "the actions of one model are relative to the present motion and those of the other are "
        "not: they do not mean the same");
  }
  const auto ours = CandidatesOf(first, first_shares, times);
  if (!ours.ok()) return ours.status();
  const auto theirs = CandidatesOf(second, second_shares, times);
  if (!theirs.ok()) return theirs.status();
  v1::ActionMatching matching;
  matching.set_tolerance(kToleranceSpeed * times.back());
  AddPairs(*ours, *theirs, matching);
  AddAgreement(matching);
  return matching;
}

absl::StatusOr<v1::ActionMatching> MatchActions(const v1::ModelManifest& first,
                                                const v1::ModelManifest& second) {
  return MatchActions(first, {}, second, {});
}

}  // namespace maneuver::evaluation
