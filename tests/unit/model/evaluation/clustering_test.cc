#include "model/evaluation/clustering.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace maneuver::evaluation::clustering_test {
namespace {

void Add(ContingencyTable& table, int cluster, int label, int times) {
  for (int i = 0; i < times; ++i) table.Add(cluster, label);
}

TEST(ClusteringTest, RenamedClassesAgreeFully) {
  ContingencyTable table;
  Add(table, 7, 0, 3);
  Add(table, 2, 1, 5);
  EXPECT_NEAR(table.NormalizedMutualInformation(), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(table.Purity(), 1.0);
}

TEST(ClusteringTest, IndependentClustersShareNoInformation) {
  ContingencyTable table;
  for (int cluster = 0; cluster < 3; ++cluster) {
    Add(table, cluster, 0, 2);
    Add(table, cluster, 1, 4);
  }
  EXPECT_NEAR(table.NormalizedMutualInformation(), 0.0, 1e-12);
  EXPECT_NEAR(table.Purity(), 4.0 / 6.0, 1e-12);
}

// Clusters 0 and 1 split class A in halves of four examples each; cluster 2 is class B with eight.
// I = H(class) = ln 2, H(cluster) = 1.5 ln 2, so NMI = 2 / 2.5.
TEST(ClusteringTest, SplittingAClassCostsEntropyButNotPurity) {
  ContingencyTable table;
  Add(table, 0, 0, 4);
  Add(table, 1, 0, 4);
  Add(table, 2, 1, 8);
  EXPECT_NEAR(table.NormalizedMutualInformation(), 0.8, 1e-12);
  EXPECT_DOUBLE_EQ(table.Purity(), 1.0);
}

TEST(ClusteringTest, ASingleClusterTellsNothing) {
  ContingencyTable table;
  Add(table, 0, 0, 1);
  Add(table, 0, 1, 3);
  EXPECT_DOUBLE_EQ(table.NormalizedMutualInformation(), 0.0);
  EXPECT_DOUBLE_EQ(table.Purity(), 0.75);
}

// Rows 3 1 and 1 3: H(class) = ln 2, and 1/4 of each cluster is of the other class.
TEST(ClusteringTest, InformationIsTheEntropyThatTheClusterRemoves) {
  ContingencyTable table;
  Add(table, 0, 0, 3);
  Add(table, 0, 1, 1);
  Add(table, 1, 0, 1);
  Add(table, 1, 1, 3);
  const double left = -0.25 * std::log(0.25) - 0.75 * std::log(0.75);
  EXPECT_NEAR(table.LabelEntropy(), std::log(2.0), 1e-12);
  EXPECT_NEAR(table.MutualInformation(), std::log(2.0) - left, 1e-12);
}

// Two pairs in each cluster and of each class: of the six distributions, two agree fully and four
// share nothing.
TEST(ClusteringTest, ExpectedInformationIsPositiveByChance) {
  ContingencyTable table;
  Add(table, 0, 0, 2);
  Add(table, 1, 1, 2);
  EXPECT_NEAR(table.ExpectedMutualInformation(), std::log(2.0) / 3.0, 1e-12);
  ContingencyTable one_class;
  Add(one_class, 0, 0, 2);
  Add(one_class, 1, 0, 5);
  EXPECT_NEAR(one_class.ExpectedMutualInformation(), 0.0, 1e-12);
  // With each pair in its own cluster, any distribution determines the class.
  ContingencyTable alone;
  for (int i = 0; i < 4; ++i) alone.Add(i, i % 2);
  EXPECT_NEAR(alone.ExpectedMutualInformation(), std::log(2.0), 1e-12);
}

TEST(ClusteringTest, ExpectedInformationIsTheMeanOverAllPermutations) {
  const std::vector<int> clusters = {0, 0, 0, 1, 1, 2, 2, 2};
  std::vector<int> labels = {0, 0, 0, 0, 1, 1, 1, 2};  // sorted: the first permutation
  double sum = 0.0;
  int permutations = 0;
  ContingencyTable table;
  do {
    table = {};
    for (size_t i = 0; i < labels.size(); ++i) table.Add(clusters[i], labels[i]);
    sum += table.MutualInformation();
    ++permutations;
  } while (std::next_permutation(labels.begin(), labels.end()));
  EXPECT_EQ(permutations, 280);  // 8! / (4! 3! 1!)
  EXPECT_NEAR(table.ExpectedMutualInformation(), sum / permutations, 1e-12);
}

// Of large tables only the counts that can occur are summed.
TEST(ClusteringTest, ExpectedInformationOfALargeTableIsTheSumOverAllCounts) {
  constexpr int64_t kRows[] = {3'000, 40'000, 7};
  constexpr int64_t kColumns[] = {10'000, 33'007};
  ContingencyTable table;
  int64_t left = kColumns[0];
  for (int row = 0; row < 3; ++row) {
    const int64_t first = std::min(left, kRows[row]);
    left -= first;
    if (first > 0) Add(table, row, 0, static_cast<int>(first));
    if (kRows[row] > first) Add(table, row, 1, static_cast<int>(kRows[row] - first));
  }
  const int64_t n = table.total();
  ASSERT_EQ(n, kColumns[0] + kColumns[1]);
  const auto log_choose = [](int64_t of, int64_t k) {
    return std::lgamma(of + 1.0) - std::lgamma(k + 1.0) - std::lgamma(of - k + 1.0);
  };
  double expected = 0.0;
  for (const int64_t a : kRows) {
    for (const int64_t b : kColumns) {
      for (int64_t k = std::max<int64_t>(1, a + b - n); k <= std::min(a, b); ++k) {
        const double p = std::exp(log_choose(b, k) + log_choose(n - b, a - k) - log_choose(n, a));
        const auto count = static_cast<double>(k);
        expected += p * count / static_cast<double>(n) *
                    std::log(static_cast<double>(n) * count /
                             (static_cast<double>(a) * static_cast<double>(b)));
      }
    }
  }
  EXPECT_NEAR(table.ExpectedMutualInformation(), expected, 1e-6 * expected);
}

TEST(ClusteringTest, EachClusterHasAMajorityTheSmallestClassOnTies) {
  ContingencyTable table;
  Add(table, 4, 2, 3);
  Add(table, 4, 1, 3);
  Add(table, 4, 0, 1);
  Add(table, 9, 5, 2);
  const auto majorities = table.Majorities();
  ASSERT_EQ(majorities.size(), 2);
  EXPECT_EQ(majorities.at(4).label, 1);
  EXPECT_EQ(majorities.at(4).count, 3);
  EXPECT_DOUBLE_EQ(majorities.at(4).Purity(), 3.0 / 7.0);
  EXPECT_EQ(majorities.at(9).label, 5);
  EXPECT_EQ(majorities.at(9).total, 2);
}

TEST(ClusteringTest, CountsClustersOfExactlyTheGivenPurity) {
  ContingencyTable table;
  Add(table, 0, 0, 7);
  Add(table, 0, 1, 3);
  Add(table, 1, 0, 69);
  Add(table, 1, 1, 31);
  EXPECT_DOUBLE_EQ(table.ShareInClustersOfPurity(0.7), 10.0 / 110.0);
  EXPECT_DOUBLE_EQ(table.ShareInClustersOfPurity(0.6), 1.0);
  EXPECT_DOUBLE_EQ(ContingencyTable().ShareInClustersOfPurity(0.7), 0.0);
}

}  // namespace
}  // namespace maneuver::evaluation::clustering_test
