#include "server/serving/answer_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "server/errors/error_details.h"

namespace maneuver::serving::answer_check_test {
namespace {

using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// One action of two waypoints, a representative and a classification: all sound.
TargetAnswer Sound() {
  TargetAnswer answer;
  answer.encoding.probabilities = Eigen::Vector3d(0.2, 0.5, 0.3);
  inference::ActionDistribution action;
  action.action = 1;
  action.latent_mean = Eigen::VectorXd::Constant(2, 0.5);
  action.latent_stddev = Eigen::VectorXd::Constant(2, 1.0);
  const inference::Trajectory mean = inference::Trajectory::Constant(2, 2, 3.0);
  action.sigma = {mean, mean, mean, mean, mean};
  action.moment_mean = mean;
  action.moment_covariance.resize(2, 3);
  action.moment_covariance << 4.0, -6.0, 9.0,  // singular: the bound itself
      0.0, 0.0, 2.0;
  answer.distributions.push_back(action);
  answer.representatives = {{.action = 1, .weight = 0.7}, {.action = 2, .weight = 0.3}};
  answer.classification = inference::Classification{
      .responsibilities = Eigen::Vector3d(0.0, 1.0, 0.0), .log_likelihood_bound = -3.0};
  return answer;
}

struct Fault {
  std::string name;
  std::string message;  // part of it
  std::function<void(TargetAnswer&)> spoil;
};

class UnsoundAnswerTest : public testing::TestWithParam<Fault> {};

TEST_P(UnsoundAnswerTest, AnInvalidAnswerIsInternalAndSaysWhy) {
  TargetAnswer answer = Sound();
  GetParam().spoil(answer);
  const absl::Status status = CheckAnswer(answer);
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_EQ(errors::ReasonOf(status), "ANSWER_UNSOUND");
  EXPECT_THAT(std::string(status.message()), HasSubstr(GetParam().message));
}

inference::ActionDistribution& Action(TargetAnswer& answer) { return answer.distributions[0]; }

INSTANTIATE_TEST_SUITE_P(
    Each, UnsoundAnswerTest,
    testing::Values(
        Fault{"ProbabilityNan", "p(y|s)", [](auto& a) { a.encoding.probabilities[1] = kNan; }},
        Fault{"ProbabilityInfinite", "p(y|s)",
              [](auto& a) { a.encoding.probabilities[1] = kInfinity; }},
        Fault{"ProbabilityNegative", "p(y|s)",
              [](auto& a) { a.encoding.probabilities = Eigen::Vector3d(-0.1, 0.6, 0.5); }},
        Fault{"ProbabilitiesOfMoreThanOne", "p(y|s)",
              [](auto& a) { a.encoding.probabilities[0] += 2e-5; }},
        Fault{"LatentMean", "action 1: its latent",
              [](auto& a) { Action(a).latent_mean[1] = kNan; }},
        Fault{"LatentStddev", "action 1: its latent",
              [](auto& a) { Action(a).latent_stddev[0] = kInfinity; }},
        Fault{"SigmaTrajectory", "action 1: its trajectory",
              [](auto& a) {
                const inference::Trajectory good = inference::Trajectory::Zero(2, 2);
                inference::Trajectory bad = good;
                bad(1, 1) = kNan;
                Action(a).sigma = {good, good, good, good, bad};
              }},
        Fault{"MomentMean", "action 1: its trajectory",
              [](auto& a) { Action(a).moment_mean(0, 1) = -kInfinity; }},
        Fault{"CovarianceNan", "action 1: its covariance is not finite",
              [](auto& a) { Action(a).moment_covariance(1, 2) = kNan; }},
        Fault{"CovarianceOfNegativeVariance", "not positive semi-definite",
              [](auto& a) { Action(a).moment_covariance(1, 2) = -1e-3; }},
        Fault{"CovarianceTooCorrelated", "not positive semi-definite",
              [](auto& a) { Action(a).moment_covariance(0, 1) = 6.001; }},
        Fault{"Weights", "weights", [](auto& a) { a.representatives[0].weight = 0.8; }},
        Fault{"WeightNan", "weights", [](auto& a) { a.representatives[0].weight = kNan; }},
        Fault{"JointTrajectory", "combine",
              [](auto& a) { a.joint.means = {inference::Trajectory::Constant(2, 2, kNan)}; }},
        Fault{"Responsibilities", "q(y|x,s)",
              [](auto& a) { a.classification->responsibilities[0] = kNan; }},
        Fault{"Bound", "log-likelihood",
              [](auto& a) { a.classification->log_likelihood_bound = -kInfinity; }}),
    [](const auto& fault) { return fault.param.name; });

TEST(AnswerCheckTest, AcceptsAValidAnswer) {
  EXPECT_TRUE(CheckAnswer(Sound()).ok()) << CheckAnswer(Sound());
  TargetAnswer probabilities_alone;
  probabilities_alone.encoding.probabilities = Eigen::Vector2d(0.5, 0.500009);
  EXPECT_TRUE(CheckAnswer(probabilities_alone).ok());
}

}  // namespace
}  // namespace maneuver::serving::answer_check_test
