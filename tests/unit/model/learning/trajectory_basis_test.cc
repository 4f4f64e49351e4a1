#include "model/learning/trajectory_basis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace maneuver::learning::trajectory_basis_test {
namespace {

std::vector<double> Times(int waypoints, double interval) {
  std::vector<double> times;
  for (int i = 1; i <= waypoints; ++i) times.push_back(i * interval);
  return times;
}

Eigen::VectorXf Sampled(const std::vector<double>& times, auto position) {
  Eigen::VectorXf values(static_cast<Eigen::Index>(times.size()));
  for (size_t i = 0; i < times.size(); ++i) {
    values[static_cast<Eigen::Index>(i)] = static_cast<float>(position(times[i]));
  }
  return values;
}

float Residual(const Eigen::MatrixXf& basis, const Eigen::VectorXf& values) {
  return (values - basis * (basis.transpose() * values)).cwiseAbs().maxCoeff();
}

TEST(TrajectoryBasisTest, IsOrthonormal) {
  const Eigen::MatrixXf basis = SplineBasis(Times(50, 0.1), 0.8);
  EXPECT_EQ(basis.rows(), 50);
  EXPECT_EQ(basis.cols(), 8);  // 6 intervals of a cubic spline that starts at 0
  EXPECT_LT((basis.transpose() * basis - Eigen::MatrixXf::Identity(8, 8)).cwiseAbs().maxCoeff(),
            1e-5f);
}

// Any cubic that starts at 0 is a cubic spline that does.
TEST(TrajectoryBasisTest, HoldsEveryCubicThatStartsAtTheOrigin) {
  const std::vector<double> times = Times(25, 0.2);
  const Eigen::MatrixXf basis = SplineBasis(times, 0.8);
  EXPECT_LT(Residual(basis, Sampled(times, [](double t) { return 12 * t - 2 * t * t; })), 1e-4f);
  EXPECT_LT(Residual(basis, Sampled(times, [](double t) { return 0.3 * t * t * t - t; })), 1e-4f);
  // One that does not start there is not.
  EXPECT_GT(Residual(basis, Sampled(times, [](double) { return 1.0; })), 0.1f);
}

// Braking at 4 m/s^2 to a stop after 2 s has a corner in its acceleration.
TEST(TrajectoryBasisTest, FollowsABrakingVehicleToADecimetre) {
  const std::vector<double> times = Times(50, 0.1);
  const auto stop = [](double t) { return t < 2.0 ? 8.0 * t - 2.0 * t * t : 8.0; };
  EXPECT_LT(Residual(SplineBasis(times, 0.8), Sampled(times, stop)), 0.1f);
}

TEST(TrajectoryBasisTest, DoesNotFollowJitter) {
  const std::vector<double> times = Times(50, 0.1);
  const Eigen::MatrixXf basis = SplineBasis(times, 0.8);
  const Eigen::VectorXf jitter =
      Sampled(times, [](double t) { return std::lround(t / 0.1) % 2 == 0 ? 0.5 : -0.5; });
  EXPECT_LT((basis * (basis.transpose() * jitter)).norm(), 0.2f * jitter.norm());
}

TEST(TrajectoryBasisTest, FewWaypointsHaveOneFunctionEach) {
  EXPECT_EQ(SplineBasis(Times(4, 1.0), 0.8), Eigen::MatrixXf(Eigen::MatrixXf::Identity(4, 4)));
}

}  // namespace
}  // namespace maneuver::learning::trajectory_basis_test
