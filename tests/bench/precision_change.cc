#include "tests/bench/precision_change.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "tests/bench/bench_scenes.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {
namespace {

// Returns an answer with every action of every target.
v1::PredictResponse Answer(const BenchModel& model, const v1::Scenario& scene) {
  const int actions = model.model->spec().actions();
  Pipeline pipeline(model, {RequestFor({scene}, actions)}, actions);
  pipeline.RunAll();
  v1::PredictResponse response;
  response.ParseFromString(pipeline.responses().front());
  return response;
}

struct Mean {
  double sum = 0.0;
  double largest = 0.0;
  int64_t count = 0;

  void Add(double value) {
    sum += value;
    largest = std::max(largest, value);
    ++count;
  }
  double value() const { return count > 0 ? sum / static_cast<double>(count) : 0.0; }
};

void Compare(const v1::TargetPrediction& fast, const v1::TargetPrediction& exact,
             Mean* probabilities, Mean* waypoints) {
  for (int k = 0; k < exact.probabilities_size(); ++k) {
    probabilities->Add(std::abs(fast.probabilities(k) - exact.probabilities(k)));
  }
  // Each answer lists actions in the order of its own probabilities.
  std::map<int, const v1::Trajectory*> means;
  for (const auto& distribution : fast.distributions()) {
    means[distribution.action_id()] = &distribution.mean_trajectory();
  }
  for (const auto& distribution : exact.distributions()) {
    if (distribution.probability() < kLikely) continue;
    const v1::Trajectory& here = distribution.mean_trajectory();
    const v1::Trajectory& there = *means.at(distribution.action_id());
    for (int t = 0; t < here.x_size(); ++t) {
      waypoints->Add(std::hypot(here.x(t) - there.x(t), here.y(t) - there.y(t)));
    }
  }
}

}  // namespace

PrecisionChange ChangeFromF32(const BenchModel& model, const std::vector<v1::Scenario>& scenes) {
  const BenchModel exact = WithPrecision(model, inference::Precision::kF32);
  PrecisionChange change;
  Mean probabilities;
  Mean waypoints;
  for (const v1::Scenario& scene : scenes) {
    const auto fast_answer = Answer(model, scene);
    const auto exact_answer = Answer(exact, scene);
    for (int i = 0; i < exact_answer.predictions(0).targets_size(); ++i) {
      Compare(fast_answer.predictions(0).targets(i), exact_answer.predictions(0).targets(i),
              &probabilities, &waypoints);
      ++change.targets;
    }
  }
  change.largest_probability = probabilities.largest;
  change.mean_probability = probabilities.value();
  change.largest_waypoint = waypoints.largest;
  change.mean_waypoint = waypoints.value();
  return change;
}

}  // namespace maneuver::bench
