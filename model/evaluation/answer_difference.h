// Measures how far two versions differ in their answers for the same target. They may have
// different actions and waypoints.
//
// A version's answer for a target is p(y|s) and the distribution of each action. Without ground
// truth neither version is right; equal answers have distance 0.

#ifndef MANEUVER_MODEL_EVALUATION_ANSWER_DIFFERENCE_H_
#define MANEUVER_MODEL_EVALUATION_ANSWER_DIFFERENCE_H_

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/model.pb.h"
#include "model/inference/action_model.h"

namespace maneuver::evaluation {

// One version's answer for a target.
struct VersionAnswer {
  Eigen::VectorXd probabilities;  // p(y|s), [K]
  // The actions of the mixture, as Describe returns them. At least one must have a positive
  // probability. Their probabilities are renormalised to sum to 1.
  std::vector<inference::ActionDistribution> actions;
};

// The distance d of two trajectories is the average displacement, metres, at the waypoints of the
// first version that lie within the horizon of both. If the second version has other waypoint
// times, it is interpolated linearly, from the origin at time 0.
//
// The first version answers probabilities p_i with mean trajectories m_i, the second q_j with n_j.
struct AnswerDifference {
  // Distance of the expected trajectories, d(sum_i p_i m_i, sum_j q_j n_j), metres.
  double expected = 0.0;
  // d(m_i, n_j) of the most probable i and j, metres. Of equally probable actions, the smaller id
  // counts.
  double likeliest = 0.0;
  // The energy distance of the mixtures of mean trajectories, metres:
  //   2 sum_ij p_i q_j d(m_i, n_j) - sum_ii' p_i p_i' d(m_i, m_i') - sum_jj' q_j q_j' d(n_j, n_j')
  // It is at least 0, and 0 only for equal mixtures (Szekely and Rizzo, "Energy statistics: A class
  // of statistics based on distances", 2013). For two versions that are each certain of one
  // trajectory, it is twice the distance of the two.
  double energy = 0.0;
  // The entropy -sum_k p_k ln p_k of each version's p(y|s), nats.
  double first_entropy = 0.0;
  double second_entropy = 0.0;
  // The Jensen-Shannon divergence of p(y|s) over common outcomes, nats, 0 to ln 2 (Lin, "Divergence
  // measures based on the Shannon entropy", 1991). Outcomes that both versions share are each pair
  // of actions that MatchActions calls agreeing (action_matching.h), and "any ineffective action".
  // Each other effective action is an outcome to which the other version gives no probability.
  // Nothing if the divergence is unknown.
  std::optional<double> divergence;
};

// Immutable; thread-safe.
class AnswerComparison {
 public:
  // Prepares the comparison of two versions. INVALID_ARGUMENT if the first version's waypoints all
  // lie beyond the second's horizon. The divergence is unknown for versions that MatchActions
  // refuses: their waypoints are at different times, one has no effective action, or only one has a
  // reference.
  static absl::StatusOr<AnswerComparison> Make(const v1::ModelManifest& first,
                                               const v1::ModelManifest& second);

  // Compares answers of the two manifests' models.
  AnswerDifference Compare(const VersionAnswer& first, const VersionAnswer& second) const;

  // Returns how many effective actions of each version are in agreeing pairs; 0 if the divergence
  // is unknown.
  int agreeing_pairs() const { return agreeing_pairs_; }

 private:
  // A time between two waypoints of a version: (1 - weight) of the earlier plus weight of the
  // later. Before waypoint 0 comes the origin at time 0.
  struct Place {
    Eigen::Index later = 0;
    double weight = 1.0;
  };

  AnswerComparison() = default;
  // Adds up the probabilities of the actions that have the same symbol. A symbol is the number of a
  // common outcome: one number means the same in both versions.
  Eigen::VectorXd SymbolProbabilities(const Eigen::VectorXd& probabilities,
                                      std::span<const Eigen::Index> symbols) const;
  void MatchSymbols(const v1::ModelManifest& first, const v1::ModelManifest& second);

  Eigen::Index times_ = 0;     // first waypoints of the first version
  std::vector<Place> places_;  // [times] these times among the second's waypoints
  // [K] of each version: the symbol of each action; empty if the divergence is unknown.
  std::vector<Eigen::Index> first_symbols_;
  std::vector<Eigen::Index> second_symbols_;
  Eigen::Index symbols_ = 0;
  int agreeing_pairs_ = 0;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANSWER_DIFFERENCE_H_
