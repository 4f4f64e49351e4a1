#include "model/evaluation/calibration.h"

#include <algorithm>
#include <cmath>

namespace maneuver::evaluation {

double Entropy(const Eigen::VectorXd& p) {
  double entropy = 0.0;
  for (const double value : p) {
    if (value > 0.0) entropy -= value * std::log(value);
  }
  return entropy;
}

ActionStatistics::ActionStatistics(int actions)
    : sum_(Eigen::VectorXd::Zero(actions)), largest_(Eigen::VectorXd::Zero(actions)) {}

void ActionStatistics::Add(const Eigen::VectorXd& predicted,
                           const Eigen::VectorXd& responsibilities) {
  sum_ += predicted;
  largest_ = largest_.cwiseMax(predicted);
  entropy_sum_ += Entropy(predicted);
  Eigen::Index top = 0;
  const double confidence = predicted.maxCoeff(&top);
  // NaN goes to the last bin; the figures are then not finite, and CheckFinite reports them.
  const int bin = confidence < 1.0 ? std::max(0, static_cast<int>(confidence * kBins)) : kBins - 1;
  bins_[bin].confidence += confidence;
  bins_[bin].responsibility += responsibilities[top];
  ++bins_[bin].examples;
  ++count_;
}

void ActionStatistics::Add(const ActionStatistics& other) {
  sum_ += other.sum_;
  largest_ = largest_.cwiseMax(other.largest_);
  entropy_sum_ += other.entropy_sum_;
  for (size_t i = 0; i < bins_.size(); ++i) {
    bins_[i].examples += other.bins_[i].examples;
    bins_[i].confidence += other.bins_[i].confidence;
    bins_[i].responsibility += other.bins_[i].responsibility;
  }
  count_ += other.count_;
}

Eigen::VectorXd ActionStatistics::MeanProbability() const {
  return count_ == 0 ? sum_ : Eigen::VectorXd(sum_ / static_cast<double>(count_));
}

int ActionStatistics::EffectiveActions() const {
  return static_cast<int>((largest_.array() >= kEffectiveProbability).count());
}

double ActionStatistics::Perplexity() const { return std::exp(Entropy(MeanProbability())); }

double ActionStatistics::MutualInformation() const {
  return Entropy(MeanProbability()) - MeanEntropy();
}

double ActionStatistics::MeanEntropy() const {
  return count_ == 0 ? 0.0 : entropy_sum_ / static_cast<double>(count_);
}

double ActionStatistics::ExpectedCalibrationError() const {
  if (count_ == 0) return 0.0;
  double error = 0.0;
  for (const Bin& bin : bins_) error += std::abs(bin.confidence - bin.responsibility);
  return error / static_cast<double>(count_);
}

}  // namespace maneuver::evaluation
