#include "model/artifact/model_weights.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "model/artifact/model_spec.h"

namespace maneuver::artifact {
namespace {

// Relative tolerance for covariances that rounding to 32-bit floats makes indefinite.
constexpr double kCovarianceTolerance = 1e-5;

int64_t CountValues(const std::vector<int64_t>& shape) {
  int64_t count = 1;
  for (const int64_t size : shape) count *= size;
  return count;
}

bool AllAre(const Tensor& tensor, bool (*predicate)(float)) {
  return std::all_of(tensor.values.begin(), tensor.values.end(), predicate);
}

// Checks a tensor [.., 3] of xx, xy, yy.
bool ArePositiveSemidefinite(const Tensor& covariance) {
  for (size_t i = 0; i + 2 < covariance.values.size(); i += 3) {
    const double xx = covariance.values[i];
    const double xy = covariance.values[i + 1];
    const double yy = covariance.values[i + 2];
    if (xx < 0 || yy < 0 || xy * xy > xx * yy * (1 + kCovarianceTolerance)) return false;
  }
  return true;
}

}  // namespace

std::string FindWeightFault(const v1::ModelSpec& spec, const TensorMap& weights) {
  const auto shapes = TensorShapes(spec);
  for (const auto& [name, shape] : shapes) {
    const auto found = weights.find(name);
    if (found == weights.end()) return absl::StrCat("tensor ", name, " is missing");
    const Tensor& tensor = found->second;
    if (tensor.shape != shape || static_cast<int64_t>(tensor.values.size()) != CountValues(shape)) {
      return absl::StrCat("tensor ", name, " has shape [", absl::StrJoin(tensor.shape, ", "),
                          "], the spec says [", absl::StrJoin(shape, ", "), "]");
    }
    if (!AllAre(tensor, [](float v) { return std::isfinite(v); })) {
      return absl::StrCat("tensor ", name, " holds a value that is not finite");
    }
    if (absl::EndsWith(name, ".running_var") && !AllAre(tensor, [](float v) { return v >= 0; })) {
      return absl::StrCat("tensor ", name, " holds a negative variance");
    }
  }
  for (const auto& [name, tensor] : weights) {
    if (!shapes.contains(name)) return absl::StrCat("tensor ", name, " is not part of the spec");
  }
  if (!AllAre(weights.at("trajectory.stddev"), [](float v) { return v > 0; })) {
    return "tensor trajectory.stddev holds a standard deviation that is not positive";
  }
  const auto factor = weights.find("scene_covariance.speed_factor");
  if (factor != weights.end() && !AllAre(factor->second, [](float v) { return v >= 0; })) {
    return "tensor scene_covariance.speed_factor holds a negative factor of a variance";
  }
  const auto covariance = weights.find("decoder.covariance");
  if (covariance != weights.end() && !ArePositiveSemidefinite(covariance->second)) {
    return "tensor decoder.covariance holds a matrix that is not positive semi-definite";
  }
  return "";
}

}  // namespace maneuver::artifact
