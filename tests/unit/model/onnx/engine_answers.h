// This engine's answers for some scenes, and their comparison with another engine's.

#ifndef MANEUVER_TESTS_UNIT_MODEL_ONNX_ENGINE_ANSWERS_H_
#define MANEUVER_TESTS_UNIT_MODEL_ONNX_ENGINE_ANSWERS_H_

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <numeric>
#include <span>
#include <vector>

#include "model/artifact/model_folder.h"
#include "model/inference/action_model.h"

namespace maneuver::onnx {

// Bounds for differences that other orders of summation in f32 cause.
inline constexpr double kFeatureBound = 1e-5;      // relative to the largest feature
inline constexpr double kProbabilityBound = 2e-6;  // absolute
inline constexpr double kLatentBound = 3e-5;       // absolute, of values of order 1
inline constexpr double kWaypointBound = 1e-4;     // metres

// The answers of all scenes, one after the other.
struct Answers {
  std::vector<double> features, probabilities, latent_mean, latent_stddev, trajectories;
};

template <typename Values>
void Append(const Values& values, std::vector<double>* all) {
  for (auto value = values.data(); value != values.data() + values.size(); ++value) {
    all->push_back(static_cast<double>(*value));
  }
}

inline Answers EngineAnswers(const artifact::StoredModel& model,
                             std::span<const inference::SceneInputsView> scenes) {
  const auto loaded =
      inference::ActionModel::FromStored(model, {inference::Precision::kF32}).value();
  const auto session = loaded->NewSession();
  std::vector<inference::SceneEncoding> encodings(scenes.size());
  session->Encode(scenes, encodings);
  std::vector<int> actions(static_cast<size_t>(loaded->spec().actions()));
  std::iota(actions.begin(), actions.end(), 0);
  Answers answers;
  for (const inference::SceneEncoding& encoding : encodings) {
    Append(encoding.features, &answers.features);
    Append(encoding.probabilities, &answers.probabilities);
    for (const auto& action :
         session->Describe(encoding, actions, inference::LatentSource::kPosterior)) {
      Append(action.latent_mean, &answers.latent_mean);
      Append(action.latent_stddev, &answers.latent_stddev);
      for (size_t p = 0; p < action.sigma.size(); ++p) {
        Append(action.sigma[p], &answers.trajectories);
      }
    }
  }
  return answers;
}

// Returns the largest difference; NaN if the numbers of values differ.
inline double LargestDifference(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size() || a.empty()) return std::nan("");
  double largest = 0.0;
  for (size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
  return largest;
}

inline double Largest(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double value : values) largest = std::max(largest, std::abs(value));
  return largest;
}

// Expects each part within its bound and prints the differences.
inline void ExpectSame(const Answers& theirs, const Answers& ours) {
  const auto expect = [&](const char* what, const std::vector<double>& a,
                          const std::vector<double>& b, double bound) {
    const double difference = LargestDifference(a, b);
    EXPECT_LE(difference, bound) << what;
    std::cout << what << ": largest difference " << difference << ", bound " << bound << "\n";
  };
  expect("features", theirs.features, ours.features, kFeatureBound * Largest(ours.features));
  expect("probabilities", theirs.probabilities, ours.probabilities, kProbabilityBound);
  expect("latent_mean", theirs.latent_mean, ours.latent_mean, kLatentBound);
  expect("latent_stddev", theirs.latent_stddev, ours.latent_stddev, kLatentBound);
  expect("trajectories", theirs.trajectories, ours.trajectories, kWaypointBound);
}

// Returns the largest difference relative to its bound.
inline double InBounds(const Answers& wrong, const Answers& right) {
  return std::max(
      {LargestDifference(wrong.features, right.features) / kFeatureBound / Largest(right.features),
       LargestDifference(wrong.probabilities, right.probabilities) / kProbabilityBound,
       LargestDifference(wrong.latent_mean, right.latent_mean) / kLatentBound,
       LargestDifference(wrong.latent_stddev, right.latent_stddev) / kLatentBound,
       LargestDifference(wrong.trajectories, right.trajectories) / kWaypointBound});
}

}  // namespace maneuver::onnx

#endif  // MANEUVER_TESTS_UNIT_MODEL_ONNX_ENGINE_ANSWERS_H_
