// Chooses the examples of an epoch, and their order.

#ifndef MANEUVER_MODEL_LEARNING_EXAMPLE_ORDER_H_
#define MANEUVER_MODEL_LEARNING_EXAMPLE_ORDER_H_

#include <cstdint>
#include <span>
#include <vector>

#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/tensors.h"
#include "model/learning/training_data.h"

namespace maneuver::learning {

// Returns examples.dataset_weights as a span.
inline std::span<const double> DatasetWeights(const v1::TrainingSettings& settings) {
  const auto& weights = settings.examples().dataset_weights();
  return {weights.data(), static_cast<size_t>(weights.size())};
}

// Returns the number of training examples of each dataset; one total if the datasets are not known.
inline std::vector<int64_t> DatasetSizes(const TrainingData& data) {
  if (!data.folder_examples.empty()) return data.folder_examples;
  return {static_cast<int64_t>(data.training.examples.size())};
}

// Returns how many of `count` examples each dataset gives: proportional to its weight, to within
// one.
//   weights: positive, one or more
std::vector<int64_t> SharesOf(std::span<const double> weights, int64_t count);

// Draws `count` examples in random order. Returns [count] indices; the first sizes[0] indices are
// the first dataset, and so on. Without weights each example is drawn at most once. With weights
// each dataset gives its share, and its examples are drawn equally often, to within one.
//   sizes: examples of each dataset; count is at most their sum
//   weights: empty, or one for each dataset; then no dataset is empty
at::Tensor DrawExamples(std::span<const int64_t> sizes, std::span<const double> weights,
                        int64_t count, at::Generator& generator);

// Returns the indices of `count` examples spread evenly: over all of them, or over each dataset's
// share. [count]
at::Tensor SpreadExamples(std::span<const int64_t> sizes, std::span<const double> weights,
                          int64_t count);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_EXAMPLE_ORDER_H_
