// How far two versions differ in what they answer for the same target, whichever actions and
// waypoints each of them has.
//
// A version says of a target: p(y|s), and what each action would look like. Without ground truth
// none of the two is right; equal answers have distance 0.

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

// What one version says of a target.
struct VersionAnswer {
  Eigen::VectorXd probabilities;  // p(y|s), [K]
  // Of the actions that make up the mixture, at least one of them likely; as Describe answers.
  // Their probabilities are renormalised to sum to 1.
  std::vector<inference::ActionDistribution> actions;
};

// The distance d of two trajectories is the average displacement, metres, at the waypoints of the
// first version that lie within the horizon of both. Where the second has its waypoints at other
// times it is taken to move straight between them, from the origin at time 0.
//
// The versions say p_i with mean trajectories m_i, and q_j with n_j.
struct AnswerDifference {
  // d(sum_i p_i m_i, sum_j q_j n_j): of the expected trajectories, metres.
  double expected = 0.0;
  // d(m_i, n_j) of the most probable i and j, of equal ones the smaller id: metres.
  double likeliest = 0.0;
  // The energy distance of the mixtures of mean trajectories, metres:
  //   2 sum_ij p_i q_j d(m_i, n_j) - sum_ii' p_i p_i' d(m_i, m_i') - sum_jj' q_j q_j' d(n_j, n_j')
  // At least 0, and 0 for no two mixtures but the same (Szekely and Rizzo, "Energy statistics: A
  // class of statistics based on distances", 2013). Two versions that give certain, other answers:
  // twice their distance.
  double energy = 0.0;
  // -sum_k p_k ln p_k of p(y|s), of each version: nats.
  double first_entropy = 0.0;
  double second_entropy = 0.0;
  // The Jensen-Shannon divergence of p(y|s) over what both can say: nats, 0 to ln 2 (Lin,
  // "Divergence measures based on the Shannon entropy", 1991). Nothing if that is not known.
  // Both can say that it is one of the pairs that MatchActions calls agreeing (action_matching.h),
  // or an action that is effective in no version; effective actions without such a partner are
  // outcomes of their own, which the other version gives no probability.
  std::optional<double> divergence;
};

// Immutable; safe to use from any thread.
class AnswerComparison {
 public:
  // INVALID_ARGUMENT if the first version's waypoints all lie behind the second's horizon. The
  // divergence is not known for versions that MatchActions refuses: their waypoints are at
  // different times, one has no effective action, or one of them alone has a reference.
  static absl::StatusOr<AnswerComparison> Make(const v1::ModelManifest& first,
                                               const v1::ModelManifest& second);

  // Answers as the two manifests' models give them.
  AnswerDifference Compare(const VersionAnswer& first, const VersionAnswer& second) const;

  // Of the effective actions of each version, those in agreeing pairs; 0 if there is no divergence.
  int agreeing_pairs() const { return agreeing_pairs_; }

 private:
  // A time between two waypoints of a version: 1 - weight of the earlier, weight of the later. The
  // earlier one of waypoint 0 is the origin at time 0.
  struct Place {
    Eigen::Index later = 0;
    double weight = 1.0;
  };

  AnswerComparison() = default;
  // By number of symbol, which say the same in both versions.
  Eigen::VectorXd SymbolProbabilities(const Eigen::VectorXd& probabilities,
                                      std::span<const Eigen::Index> symbols) const;
  void MatchSymbols(const v1::ModelManifest& first, const v1::ModelManifest& second);

  Eigen::Index times_ = 0;     // first waypoints of the first version
  std::vector<Place> places_;  // [times] of these times among the second's
  // [K] of each version, the symbol that an action is; empty if there is no divergence.
  std::vector<Eigen::Index> first_symbols_;
  std::vector<Eigen::Index> second_symbols_;
  Eigen::Index symbols_ = 0;
  int agreeing_pairs_ = 0;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_ANSWER_DIFFERENCE_H_
