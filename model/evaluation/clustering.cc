#include "model/evaluation/clustering.h"

#include <algorithm>
#include <cmath>

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

}  // namespace

void ContingencyTable::Add(int cluster, int label) {
  ++counts_[{cluster, label}];
  ++clusters_[cluster];
  ++labels_[label];
  ++total_;
}

double ContingencyTable::Purity() const {
  std::map<int, int64_t> largest;
  for (const auto& [pair, count] : counts_) {
    int64_t& most = largest[pair.first];
    most = std::max(most, count);
  }
  int64_t agreeing = 0;
  for (const auto& [_, count] : largest) agreeing += count;
  return total_ == 0 ? 0.0 : static_cast<double>(agreeing) / static_cast<double>(total_);
}

double ContingencyTable::NormalizedMutualInformation() const {
  if (clusters_.size() < 2 || labels_.size() < 2) return 0.0;
  const auto total = static_cast<double>(total_);
  double information = 0.0;
  for (const auto& [pair, count] : counts_) {
    const double joint = static_cast<double>(count) / total;
    const double independent = static_cast<double>(clusters_.at(pair.first)) / total *
                               static_cast<double>(labels_.at(pair.second)) / total;
    information += joint * std::log(joint / independent);
  }
  return 2.0 * information / (Entropy(clusters_, total) + Entropy(labels_, total));
}

}  // namespace maneuver::evaluation
