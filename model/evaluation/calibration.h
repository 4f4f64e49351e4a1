// Measures how good the probabilities of a predictor are.

#ifndef MANEUVER_MODEL_EVALUATION_CALIBRATION_H_
#define MANEUVER_MODEL_EVALUATION_CALIBRATION_H_

#include <Eigen/Core>
#include <array>
#include <cstdint>

namespace maneuver::evaluation {

// Returns H(p) = -sum p ln p, nats.
//   p: probabilities that sum to 1
double Entropy(const Eigen::VectorXd& p);

// Collects p(y|s) and q(y|x,s) over examples.
class ActionStatistics {
 public:
  explicit ActionStatistics(int actions);

  // Adds an example.
  //   predicted: p(y|s), [K];  responsibilities: q(y|x,s), [K]
  void Add(const Eigen::VectorXd& predicted, const Eigen::VectorXd& responsibilities);
  // Adds the examples of other statistics of as many actions.
  void Add(const ActionStatistics& other);

  // Returns the mean p(y|s), [K].
  Eigen::VectorXd MeanProbability() const;
  // Returns the largest p(y|s) of each action over the examples, [K].
  const Eigen::VectorXd& LargestProbability() const { return largest_; }
  // Returns the number of actions that have at least kEffectiveProbability in some example.
  int EffectiveActions() const;
  // Returns exp H(mean p(y|s)), between 1 and K.
  double Perplexity() const;
  // Returns I(y;s) = H(mean p(y|s)) - mean H(p(y|s)), nats.
  double MutualInformation() const;
  // Returns the mean H(p(y|s)), nats.
  double MeanEntropy() const;
  // A bin of the calibration error. It contains its lower end; the last bin also contains 1.
  struct Bin {
    int64_t examples = 0;
    double confidence = 0.0;      // sum of the largest p(y|s)
    double responsibility = 0.0;  // sum of q(y|x,s) of that action
  };
  static constexpr int kBins = 10;
  const std::array<Bin, kBins>& bins() const { return bins_; }
  // Returns the expected calibration error of the most probable action against q(y|x,s). Over ten
  // equal bins of the action's probability, it is the mean distance between that probability and
  // the share that q gives to the action.
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
