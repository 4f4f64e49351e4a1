// How well clusters agree with classes that they never saw.

#ifndef MANEUVER_MODEL_EVALUATION_CLUSTERING_H_
#define MANEUVER_MODEL_EVALUATION_CLUSTERING_H_

#include <cstdint>
#include <map>
#include <utility>

namespace maneuver::evaluation {

// Counts of (cluster, class) pairs.
class ContingencyTable {
 public:
  void Add(int cluster, int label);
  int64_t total() const { return total_; }

  // Share of the pairs whose class is the most frequent one of their cluster, in (0, 1].
  double Purity() const;

  // 2 I(cluster; class) / (H(cluster) + H(class)), in [0, 1]; 0 when one of them never varies.
  double NormalizedMutualInformation() const;

 private:
  std::map<std::pair<int, int>, int64_t> counts_;
  std::map<int, int64_t> clusters_;
  std::map<int, int64_t> labels_;
  int64_t total_ = 0;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CLUSTERING_H_
