#include "model/evaluation/clustering.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace maneuver::evaluation {
namespace {

double Entropy(const std::map<int, int64_t>& counts, double total) {
  double entropy = 0.0;
  for (const auto& [_, count] : counts) {
    const double p = static_cast<double>(count) / total;
    entropy -= p * std::log(p);
  }
  return entropy;
}

// Returns ln 0! .. ln n!.
std::vector<double> LogFactorials(int64_t n) {
  std::vector<double> values(static_cast<size_t>(n) + 1, 0.0);
  for (size_t i = 1; i < values.size(); ++i) {
    values[i] = values[i - 1] + std::log(static_cast<double>(i));
  }
  return values;
}

// Returns the mean of (k / n) ln(n k / (a b)). k counts the pairs among n that are both among the a
// pairs of a cluster and among the b pairs of a class. It is hypergeometric, with
//   p(k) = a! b! (n - a)! (n - b)! / (n! k! (a - k)! (b - k)! (n - a - b + k)!)
// Only counts near its mean are summed. By Bernstein's inequality, which holds for it (Hoeffding,
// Probability Inequalities for Sums of Bounded Random Variables, 1963, section 6), the others have a
// probability of less than 2 exp(-t^2 / (2 (variance + t / 3))), here 1e-30.
double ExpectedTerm(int64_t a, int64_t b, int64_t n, const std::vector<double>& log_factorials) {
  const auto log_factorial = [&](int64_t i) { return log_factorials[static_cast<size_t>(i)]; };
  const double of_margins = log_factorial(a) + log_factorial(b) + log_factorial(n - a) +
                            log_factorial(n - b) - log_factorial(n);
  const auto total = static_cast<double>(n);
  const double independent = static_cast<double>(a) * static_cast<double>(b) / total;
  double expected = 0.0;
  const double reach = 100.0 + 15.0 * std::sqrt(independent);
  const auto from = static_cast<int64_t>(std::max(1.0, independent - reach));
  const auto to = static_cast<int64_t>(independent + reach);
  for (int64_t k = std::max(from, a + b - n); k <= std::min({a, b, to}); ++k) {
    const double log_probability = of_margins - log_factorial(k) - log_factorial(a - k) -
                                   log_factorial(b - k) - log_factorial(n - a - b + k);
    const auto count = static_cast<double>(k);
    expected += std::exp(log_probability) * count / total * std::log(count / independent);
  }
  return expected;
}

}  // namespace

void ContingencyTable::Add(int cluster, int label, int64_t times) {
  counts_[{cluster, label}] += times;
  clusters_[cluster] += times;
  labels_[label] += times;
  total_ += times;
}

void ContingencyTable::Add(const ContingencyTable& other) {
  for (const auto& [pair, count] : other.counts_) Add(pair.first, pair.second, count);
}

std::map<int, ContingencyTable::Majority> ContingencyTable::Majorities() const {
  std::map<int, Majority> majorities;
  for (const auto& [pair, count] : counts_) {
    Majority& majority = majorities[pair.first];
    majority.total += count;
    if (count <= majority.count) continue;
    majority.label = pair.second;
    majority.count = count;
  }
  return majorities;
}

double ContingencyTable::Purity() const {
  int64_t agreeing = 0;
  for (const auto& [_, majority] : Majorities()) agreeing += majority.count;
  return total_ == 0 ? 0.0 : static_cast<double>(agreeing) / static_cast<double>(total_);
}

double ContingencyTable::ShareInClustersOfPurity(double purity) const {
  constexpr double kRounding = 1e-12;
  int64_t pure = 0;
  for (const auto& [_, majority] : Majorities()) {
    if (majority.Purity() >= purity - kRounding) pure += majority.total;
  }
  return total_ == 0 ? 0.0 : static_cast<double>(pure) / static_cast<double>(total_);
}

double ContingencyTable::LabelEntropy() const {
  return Entropy(labels_, static_cast<double>(total_));
}

double ContingencyTable::MutualInformation() const {
  const auto total = static_cast<double>(total_);
  double information = 0.0;
  for (const auto& [pair, count] : counts_) {
    const double joint = static_cast<double>(count) / total;
    const double independent = static_cast<double>(clusters_.at(pair.first)) / total *
                               static_cast<double>(labels_.at(pair.second)) / total;
    information += joint * std::log(joint / independent);
  }
  return std::max(0.0, information);
}

double ContingencyTable::ExpectedMutualInformation() const {
  const std::vector<double> log_factorials = LogFactorials(total_);
  double expected = 0.0;
  for (const auto& [cluster, in_cluster] : clusters_) {
    for (const auto& [label, of_label] : labels_) {
      expected += ExpectedTerm(in_cluster, of_label, total_, log_factorials);
    }
  }
  return expected;
}

double ContingencyTable::NormalizedMutualInformation() const {
  if (clusters_.size() < 2 || labels_.size() < 2) return 0.0;
  const auto total = static_cast<double>(total_);
  return 2.0 * MutualInformation() / (Entropy(clusters_, total) + Entropy(labels_, total));
}

}  // namespace maneuver::evaluation
