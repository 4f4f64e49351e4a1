// Stores measurements as rows of numbers, to be averaged later.

#ifndef MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
#define MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_

#include <map>
#include <span>
#include <utility>
#include <vector>

#include "maneuver/v1/cross_validation.pb.h"
#include "model/evaluation/example_metrics.h"
#include "model/evaluation/measured_examples.h"
#include "model/evaluation/set_sums.h"

namespace maneuver::evaluation {

// Makes a set of measurements that come block by block. The set has a row of ExampleMetrics
// (example_metrics.h) for each example, some 1.3 kB, and those metrics of the whole set that are
// not means over examples: of all examples, and without those of each block of groups of
// recordings. It does not depend on how the examples come. With many groups, several share a block
// of the jackknife (Shao and Tu, The Jackknife and Bootstrap, 1995, section 2.3), so that time and
// memory are bounded.
class MeasuredSetBuilder {
 public:
  //   groups: the group of each recording of the set's plan
  explicit MeasuredSetBuilder(std::vector<int> groups) : groups_(std::move(groups)) {}

  // Adds the examples of a block; there may be none.
  //   recordings: the number of each recording of the block in the set's plan
  void Add(const MeasuredExamples& block, std::span<const int> recordings);

  // Returns the set of all blocks, which have at least one example.
  v1::MeasuredSet Build() &&;

 private:
  void Begin(const MeasuredExamples& block);

  v1::MeasuredSet set_;
  std::vector<ExampleMetric> metrics_;
  std::vector<int> groups_;
  std::map<int, SetSums> sums_;  // by block of groups
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_MEASURED_SET_H_
