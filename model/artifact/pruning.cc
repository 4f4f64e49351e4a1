#include "model/artifact/pruning.h"

#include <cmath>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/artifact/model_spec.h"

namespace maneuver::artifact {
namespace {

// Returns the names of the tensors whose leading dimension counts actions: those that would have
// another shape with one action more.
std::set<std::string> TensorsThatCountActions(v1::ModelSpec spec) {
  const auto shapes = TensorShapes(spec);
  spec.set_actions(spec.actions() + 1);
  const auto longer = TensorShapes(spec);
  std::set<std::string> names;
  for (const auto& [name, shape] : shapes) {
    if (longer.at(name) != shape) names.insert(name);
  }
  return names;
}

Tensor Rows(const Tensor& tensor, std::span<const int> kept) {
  const size_t row = tensor.values.size() / static_cast<size_t>(tensor.shape[0]);
  Tensor rows{tensor.shape, {}};
  rows.shape[0] = static_cast<int64_t>(kept.size());
  for (const int k : kept) {
    const auto begin = tensor.values.begin() + static_cast<std::ptrdiff_t>(k * row);
    rows.values.insert(rows.values.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  }
  return rows;
}

}  // namespace

absl::StatusOr<StoredModel> PruneActions(const StoredModel& model, std::span<const int> kept) {
  const v1::ModelSpec& spec = model.manifest.spec();
  std::set<int> different;
  for (const int k : kept) {
    if (k < 0 || k >= spec.actions() || !different.insert(k).second) {
      return absl::InvalidArgumentError(
          absl::StrCat("kept: ", k, " is not an action of the model, or named twice"));
    }
  }
  if (kept.size() < 2) return absl::InvalidArgumentError("kept: a model has at least two actions");

  StoredModel pruned{model.manifest, {}};
  const std::set<std::string> count_actions = TensorsThatCountActions(spec);
  for (const auto& [name, tensor] : model.weights) {
    pruned.weights[name] = count_actions.contains(name) ? Rows(tensor, kept) : tensor;
  }
  // ln p(y) is stored normalised.
  std::vector<float>& log_weights = pruned.weights.at("mixture.log_weight").values;
  double sum = 0.0;
  for (const float log_weight : log_weights) sum += std::exp(static_cast<double>(log_weight));
  for (float& log_weight : log_weights) log_weight -= static_cast<float>(std::log(sum));

  pruned.manifest.mutable_spec()->set_actions(static_cast<int32_t>(kept.size()));
  pruned.manifest.clear_actions();
  pruned.manifest.clear_metrics();
  pruned.manifest.clear_rivals();
  return pruned;
}

}  // namespace maneuver::artifact
