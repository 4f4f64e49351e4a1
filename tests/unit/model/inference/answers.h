// Comparisons of what the engine answers.

#ifndef MANEUVER_TESTS_UNIT_MODEL_INFERENCE_ANSWERS_H_
#define MANEUVER_TESTS_UNIT_MODEL_INFERENCE_ANSWERS_H_

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "model/inference/action_model.h"

namespace maneuver::inference {

template <typename Range>
std::vector<double> Doubles(const Range& values) {
  return {values.data(), values.data() + values.size()};
}

// Expects that the values differ by at most `tolerance` times the largest of the expected values.
inline void ExpectNear(const std::vector<double>& actual, const std::vector<double>& expected,
                       double tolerance, const std::string& what) {
  ASSERT_EQ(actual.size(), expected.size()) << what;
  double scale = 0;
  for (const double value : expected) scale = std::max(scale, std::abs(value));
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(actual[i], expected[i], tolerance * scale) << what << "[" << i << "]";
  }
}

// Returns whether all numbers are the same to the last bit.
template <typename A, typename B>
bool SameBits(const A& a, const B& b) {
  if (a.size() != b.size()) return false;
  return a.size() == 0 ||
         std::memcmp(a.data(), b.data(), sizeof(*a.data()) * static_cast<size_t>(a.size())) == 0;
}

inline bool SameBits(const SceneEncoding& a, const SceneEncoding& b) {
  return SameBits(a.features, b.features) && SameBits(a.probabilities, b.probabilities) &&
         SameBits(a.geometry, b.geometry) && SameBits(a.reference, b.reference) &&
         a.speed == b.speed;
}

inline bool SameBits(const ActionDistribution& a, const ActionDistribution& b) {
  bool same =
      a.action == b.action && a.sigma.size() == b.sigma.size() &&
      SameBits(a.latent_mean, b.latent_mean) && SameBits(a.latent_stddev, b.latent_stddev) &&
      SameBits(a.moment_mean, b.moment_mean) && SameBits(a.moment_covariance, b.moment_covariance);
  for (size_t p = 0; same && p < a.sigma.size(); ++p) same = SameBits(a.sigma[p], b.sigma[p]);
  return same;
}

}  // namespace maneuver::inference

#endif  // MANEUVER_TESTS_UNIT_MODEL_INFERENCE_ANSWERS_H_
