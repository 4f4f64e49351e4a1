#include "model/learning/dirichlet_weights.h"

#include <iterator>

namespace maneuver::learning {

at::Tensor ExpectedLogWeights(const at::Tensor& counts) {
  const at::Tensor exact = counts.to(at::kDouble);
  return (exact.digamma() - exact.sum().digamma()).to(counts.scalar_type());
}

at::Tensor FollowCounts(const at::Tensor& counts, const at::Tensor& responsibilities,
                        double observations, double concentration, double rate) {
  return (1.0 - rate) * counts + rate * (concentration + observations * responsibilities.mean(0));
}

std::vector<int> UnneededActions(const at::Tensor& counts, double concentration) {
  std::vector<int> unneeded;
  for (int64_t k = 0; k < counts.size(0); ++k) {
    if (counts[k].item<double>() < concentration + 1.0) unneeded.push_back(static_cast<int>(k));
  }
  // One must stay: without it, switching off would change no probability.
  if (std::ssize(unneeded) == counts.size(0) && !unneeded.empty()) {
    unneeded.erase(unneeded.begin() + counts.argmax().item<int64_t>());
  }
  return unneeded;
}

}  // namespace maneuver::learning
