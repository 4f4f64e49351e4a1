// Measures how well clusters agree with classes that were not used to form them.

#ifndef MANEUVER_MODEL_EVALUATION_CLUSTERING_H_
#define MANEUVER_MODEL_EVALUATION_CLUSTERING_H_

#include <cstdint>
#include <map>
#include <utility>

namespace maneuver::evaluation {

// Counts of (cluster, class) pairs. Entropies and information are of their shares, in nats.
class ContingencyTable {
 public:
  // Counts a pair `times` times.
  void Add(int cluster, int label, int64_t times = 1);
  // Counts the pairs of another table.
  void Add(const ContingencyTable& other);
  int64_t total() const { return total_; }

  // The most frequent class of a cluster; the smallest one if several are equally frequent.
  struct Majority {
    int label = 0;
    int64_t count = 0;  // pairs of that class
    int64_t total = 0;  // pairs of the cluster; count / total is the cluster's purity

    double Purity() const { return static_cast<double>(count) / static_cast<double>(total); }
  };
  // Returns the majority of each cluster that has a pair.
  std::map<int, Majority> Majorities() const;

  // Returns the share of the pairs whose class is the majority of their cluster; 0 without pairs.
  double Purity() const;

  // Returns the share of the pairs in clusters of at least this purity, in [0, 1].
  double ShareInClustersOfPurity(double purity) const;

  // Returns H(class).
  double LabelEntropy() const;

  // Returns I(cluster; class), at least 0. In a sample, chance alone makes it positive.
  double MutualInformation() const;

  // Returns the mean of MutualInformation() over all ways to distribute the classes of these pairs
  // over their clusters: the value that chance alone gives. Exact, by the hypergeometric
  // distribution of each count (Vinh, Epps and Bailey 2010, equation 24a).
  double ExpectedMutualInformation() const;

  // Returns 2 I(cluster; class) / (H(cluster) + H(class)), in [0, 1]; 0 if one of them never
  // varies.
  double NormalizedMutualInformation() const;

 private:
  std::map<std::pair<int, int>, int64_t> counts_;
  std::map<int, int64_t> clusters_;
  std::map<int, int64_t> labels_;
  int64_t total_ = 0;
};

}  // namespace maneuver::evaluation

#endif  // MANEUVER_MODEL_EVALUATION_CLUSTERING_H_
