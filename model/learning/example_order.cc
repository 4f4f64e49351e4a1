#include "model/learning/example_order.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace maneuver::learning {
namespace {

// 0 .. size-1 in random order, again and again, until there are `count`.
at::Tensor DrawInTurns(int64_t size, int64_t count, at::Generator& generator) {
  TORCH_CHECK(size > 0 || count == 0, "there is nothing to draw ", count, " examples from");
  std::vector<at::Tensor> turns = {at::empty({0}, at::kLong)};
  for (int64_t drawn = 0; drawn < count; drawn += size) {
    turns.push_back(
        at::randperm(size, generator, at::kLong).slice(0, 0, std::min(size, count - drawn)));
  }
  return at::cat(turns);
}

at::Tensor SpreadOver(int64_t size, int64_t count) {
  return at::arange(count, at::kLong).mul_(size).floor_divide_(std::max<int64_t>(1, count));
}

}  // namespace

std::vector<int64_t> SharesOf(std::span<const double> weights, int64_t count) {
  const double all = std::accumulate(weights.begin(), weights.end(), 0.0);
  std::vector<int64_t> shares;
  double up_to = 0.0;
  int64_t given = 0;
  for (const double weight : weights) {
    // Rounded from the start on, so that they add up.
    up_to += weight;
    const int64_t end = std::llround(up_to / all * static_cast<double>(count));
    shares.push_back(end - given);
    given = end;
  }
  return shares;
}

at::Tensor DrawExamples(std::span<const int64_t> sizes, std::span<const double> weights,
                        int64_t count, at::Generator& generator) {
  const int64_t all = std::accumulate(sizes.begin(), sizes.end(), int64_t{0});
  if (weights.empty()) return DrawInTurns(all, count, generator);
  const std::vector<int64_t> shares = SharesOf(weights, count);
  std::vector<at::Tensor> drawn;
  int64_t first = 0;
  for (size_t i = 0; i < sizes.size(); ++i) {
    drawn.push_back(DrawInTurns(sizes[i], shares[i], generator).add_(first));
    first += sizes[i];
  }
  return at::cat(drawn).index_select(0, at::randperm(count, generator, at::kLong));
}

at::Tensor SpreadExamples(std::span<const int64_t> sizes, std::span<const double> weights,
                          int64_t count) {
  const int64_t all = std::accumulate(sizes.begin(), sizes.end(), int64_t{0});
  if (weights.empty()) return SpreadOver(all, count);
  const std::vector<int64_t> shares = SharesOf(weights, count);
  std::vector<at::Tensor> spread;
  int64_t first = 0;
  for (size_t i = 0; i < sizes.size(); ++i) {
    spread.push_back(SpreadOver(sizes[i], shares[i]).add_(first));
    first += sizes[i];
  }
  return at::cat(spread);
}

}  // namespace maneuver::learning
