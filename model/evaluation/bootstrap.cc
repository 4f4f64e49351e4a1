#include "model/evaluation/bootstrap.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/data/stable_hash.h"

namespace maneuver::evaluation {
namespace {

constexpr uint64_t kBootstrapSeed = 0x626F6F74;  // keeps these draws apart from other hashes

//   sorted: at least one;  share: in [0, 1]
double Quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(place);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

}  // namespace

Eigen::MatrixXd DrawGroups(int groups, int resamples, uint64_t seed) {
  Eigen::MatrixXd counts = Eigen::MatrixXd::Zero(resamples, groups);
  const uint64_t mixed =
      data::MixHash(kBootstrapSeed, seed);  // otherwise neighbouring seeds share draws
  for (int draw = 0; draw < resamples; ++draw) {
    const uint64_t of_draw = data::MixHash(mixed, static_cast<uint64_t>(draw));
    for (int i = 0; i < groups; ++i) {
      const double uniform = data::UnitInterval(data::MixHash(of_draw, static_cast<uint64_t>(i)));
      counts(draw, static_cast<Eigen::Index>(uniform * groups)) += 1.0;
    }
  }
  return counts;
}

Interval PercentileInterval(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  if (values.empty()) {
    constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
    return {kNan, kNan};
  }
  std::sort(values.begin(), values.end());
  return {Quantile(values, 0.025), Quantile(values, 0.975)};
}

double JackknifeError(std::span<const double> without) {
  const auto count = static_cast<double>(without.size());
  double mean = 0.0;
  for (const double value : without) mean += value / count;
  double squares = 0.0;
  for (const double value : without) squares += (value - mean) * (value - mean);
  return std::sqrt(squares * (count - 1.0) / count);
}

Interval JackknifeInterval(double value, std::span<const double> without) {
  constexpr double kNormal95 = 1.959964;
  const double half = kNormal95 * JackknifeError(without);
  return {value - half, value + half};
}

}  // namespace maneuver::evaluation
