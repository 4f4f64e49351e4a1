#include "model/evaluation/clustering.h"

#include <gtest/gtest.h>

#include <cmath>

namespace maneuver::evaluation {
namespace {

void Add(ContingencyTable& table, int cluster, int label, int times) {
  for (int i = 0; i < times; ++i) table.Add(cluster, label);
}

TEST(ClusteringTest, RenamedClassesAgreeWholly) {
  ContingencyTable table;
  Add(table, 7, 0, 3);
  Add(table, 2, 1, 5);
  EXPECT_NEAR(table.NormalizedMutualInformation(), 1.0, 1e-12);
  EXPECT_DOUBLE_EQ(table.Purity(), 1.0);
}

TEST(ClusteringTest, IndependentClustersShareNothing) {
  ContingencyTable table;
  for (int cluster = 0; cluster < 3; ++cluster) {
    Add(table, cluster, 0, 2);
    Add(table, cluster, 1, 4);
  }
  EXPECT_NEAR(table.NormalizedMutualInformation(), 0.0, 1e-12);
  EXPECT_NEAR(table.Purity(), 4.0 / 6.0, 1e-12);
}

// Clusters {0, 1} split class A in halves, cluster 2 is class B, four examples each half, eight of
// B: I = H(class) = ln 2, H(cluster) = 1.5 ln 2, so NMI = 2 / 2.5.
TEST(ClusteringTest, SplittingAClassCostsEntropyButNotPurity) {
  ContingencyTable table;
  Add(table, 0, 0, 4);
  Add(table, 1, 0, 4);
  Add(table, 2, 1, 8);
  EXPECT_NEAR(table.NormalizedMutualInformation(), 0.8, 1e-12);
  EXPECT_DOUBLE_EQ(table.Purity(), 1.0);
}

TEST(ClusteringTest, OneClusterTellsNothing) {
  ContingencyTable table;
  Add(table, 0, 0, 1);
  Add(table, 0, 1, 3);
  EXPECT_DOUBLE_EQ(table.NormalizedMutualInformation(), 0.0);
  EXPECT_DOUBLE_EQ(table.Purity(), 0.75);
}

}  // namespace
}  // namespace maneuver::evaluation
