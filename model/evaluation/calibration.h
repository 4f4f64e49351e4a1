// What the probabilities of a predictor are worth.

#ifndef MANEUVER_MODEL_EVALUATION_CALIBRATION_H_
#define MANEUVER_MODEL_EVALUATION_CALIBRATION_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>

namespace maneuver::evaluation {

// Gathers p(y|s) and q(y|x,s) over examples.
class ActionStatistics {
 public:
  explicit ActionStatistics(int actions);

  //   predicted: p(y|s), [K];  responsibilities: q(y|x,s), [K]
  void Add(const Eigen::VectorXd& predicted, const Eigen::VectorXd& responsibilities);

  // Mean p(y|s). [K]
  Eigen::VectorXd MeanProbability() const;
  // Largest p(y|s) over the examples. [K]
  const Eigen::VectorXd& LargestProbability() const { return largest_; }
  // Actions that some example gives at least kEffectiveProbability.
  int EffectiveActions() const;
  // exp H(mean p(y|s)), between 1 and K.
  double Perplexity() const;
  // I(y;s) = H(mean p(y|s)) - mean H(p(y|s)), nats.
  double MutualInformation() const;
  // Mean H(p(y|s)), nats.
  double MeanEntropy() const;
  // What the calibration error is summed over. A bin holds its lower end; the last one 1 as well.
  struct Bin {
    int64_t examples = 0;
    double confidence = 0.0;      // sum of the largest p(y|s)
    double responsibility = 0.0;  // sum of q(y|x,s) of that action
  };
  static constexpr int kBins = 10;
  const std::array<Bin, kBins>& bins() const { return bins_; }
  // Expected calibration error of the most probable action against q(y|x,s): over ten equal bins of
  // its probability, the mean distance between that probability and the share q gives to the
  // action.
  double ExpectedCalibrationError() const;

  static constexpr double kEffectiveProbability = 0.05;

 private:
  Eigen::VectorXd sum_;      // of p(y|s), [K]
  Eigen::VectorXd largest_;  // p(y|s) over examples, [K]
  double entropy_sum_ = 0.0;
  std::array<Bin, kBins> bins_{};
  int64_t count_ = 0;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CALIBRATION_H_
