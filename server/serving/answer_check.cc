#include "server/serving/answer_check.h"

#include <cmath>
#include <limits>
#include <span>

#include "absl/strings/str_cat.h"
#include "model/kernels/points.h"
#include "server/errors/error_details.h"

namespace maneuver::serving {
namespace {

constexpr double kSumTolerance = 1e-5;
// Networks may give the entries of a covariance in single precision.
constexpr double kRounding = 1e-5;

absl::Status Unsound(absl::string_view what) {
  return errors::WithReason(
      absl::InternalError(absl::StrCat("the model's answer is unsound, and was withheld: ", what,
                                       "; report the scenario, or ask another version")),
      "ANSWER_UNSOUND");
}

bool AllFinite(const double* values, Eigen::Index count) {
  return kernels::AllWithin({values, static_cast<size_t>(count)},
                            std::numeric_limits<double>::max());
}

template <typename Matrix>
bool AllFinite(const Matrix& matrix) {
  return AllFinite(matrix.data(), matrix.size());
}

bool AllFinite(const inference::TrajectorySet& set) {
  // The trajectories of a set lie one after the other.
  return set.empty() ||
         AllFinite(set[0].data(), set[0].size() * static_cast<Eigen::Index>(set.size()));
}

// Of [xx xy; xy yy] at each waypoint: xx, yy >= 0 and xy^2 <= xx yy.
bool AllPositiveSemiDefinite(const inference::WaypointCovariances& covariances) {
  bool good = true;
  for (Eigen::Index t = 0; t < covariances.rows(); ++t) {
    const double xx = covariances(t, 0);
    const double xy = covariances(t, 1);
    const double yy = covariances(t, 2);
    good &= (xx >= 0.0) & (yy >= 0.0) & (xy * xy <= xx * yy * (1.0 + kRounding));
  }
  return good;
}

absl::Status CheckDistribution(const inference::ActionDistribution& action) {
  const char* wrong = nullptr;
  if (!AllFinite(action.latent_mean) || !AllFinite(action.latent_stddev)) {
    wrong = "latent is not finite";
  } else if (!AllFinite(action.sigma) || !AllFinite(action.moment_mean)) {
    wrong = "trajectory is not finite";
  } else if (!AllFinite(action.moment_covariance)) {
    wrong = "covariance is not finite";
  } else if (!AllPositiveSemiDefinite(action.moment_covariance)) {
    wrong = "covariance is not positive semi-definite";
  }
  if (wrong == nullptr) return absl::OkStatus();
  return Unsound(absl::StrCat("action ", action.action, ": its ", wrong));
}

}  // namespace

absl::Status CheckProbabilities(const Eigen::VectorXd& probabilities, const char* what) {
  double sum = 0.0;
  bool good = true;
  for (const double probability : probabilities) {
    good &= probability >= 0.0;
    sum += probability;
  }
  // An infinite one makes the sum infinite.
  if (good && std::abs(sum - 1.0) <= kSumTolerance) return absl::OkStatus();
  return Unsound(absl::StrCat(what, " is not a distribution"));
}

absl::Status CheckAnswer(const TargetAnswer& answer) {
  if (auto status = CheckProbabilities(answer.encoding.probabilities, "p(y|s)"); !status.ok()) {
    return status;
  }
  for (const inference::ActionDistribution& action : answer.distributions) {
    if (auto status = CheckDistribution(action); !status.ok()) return status;
  }
  if (!answer.representatives.empty()) {
    double sum = 0.0;
    for (const inference::Representative& each : answer.representatives) sum += each.weight;
    if (!(std::abs(sum - 1.0) <= kSumTolerance)) {
      return Unsound("the weights of its representatives do not sum to 1");
    }
  }
  if (!AllFinite(answer.joint.means)) {
    return Unsound("a trajectory to combine with those of other targets is not finite");
  }
  if (answer.classification) {
    const inference::Classification& classification = *answer.classification;
    if (!std::isfinite(classification.log_likelihood_bound)) {
      return Unsound("the bound on the log-likelihood is not finite");
    }
    return CheckProbabilities(classification.responsibilities, "q(y|x,s)");
  }
  return absl::OkStatus();
}

}  // namespace maneuver::serving
