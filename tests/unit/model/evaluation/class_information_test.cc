#include "model/evaluation/class_information.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace maneuver::evaluation::class_information_test {
namespace {

void Add(ClassInformation& information, int condition, int cluster, int label, int times) {
  for (int i = 0; i < times; ++i) information.Add(condition, cluster, label);
}

TEST(ClassInformationTest, ClustersThatDetermineTheClassExplainAllOfIt) {
  ClassInformation information;
  Add(information, 0, 0, 3, 10);
  Add(information, 0, 1, 4, 20);
  Add(information, 0, 2, 4, 20);
  Add(information, 1, 0, 5, 7);  // another class of the same cluster, at another speed
  Add(information, 1, 1, 6, 3);
  EXPECT_NEAR(information.ExplainedShare(), 1.0, 1e-12);
}

TEST(ClassInformationTest, DoesNotCreditClustersWithWhatTheConditionTells) {
  ClassInformation information;
  for (int speed = 0; speed < 5; ++speed) Add(information, speed, speed, speed, 20);
  EXPECT_DOUBLE_EQ(information.ExplainedShare(), 0.0);
}

// Rows 3 1 and 1 3. I = ln 2 - H(1/4). By chance, k of the four pairs of a class are in the first
// cluster with probability C(4,k)^2 / 70: all or none in 2 of 70 cases (I = ln 2), three or one in
// 32 (the same I), two in the rest (0).
TEST(ClassInformationTest, SubtractsWhatChanceGives) {
  ClassInformation information;
  Add(information, 0, 0, 0, 3);
  Add(information, 0, 0, 1, 1);
  Add(information, 0, 1, 0, 1);
  Add(information, 0, 1, 1, 3);
  const double whole = std::log(2.0);
  const double told = whole + 0.25 * std::log(0.25) + 0.75 * std::log(0.75);
  const double by_chance = (2.0 * whole + 32.0 * told) / 70.0;
  EXPECT_NEAR(information.ExplainedShare(), (told - by_chance) / (whole - by_chance), 1e-12);
}

// In one condition the cluster determines the class; in another, with half as many examples, it
// tells nothing. E is (2 ln 2 + 32 I(3 of 4)) / 70 in the first, as above, and (ln 2) / 3 in the
// second.
TEST(ClassInformationTest, WeightsConditionsByTheirExamples) {
  ClassInformation information;
  Add(information, 0, 0, 0, 4);
  Add(information, 0, 1, 1, 4);
  for (int cluster = 0; cluster < 2; ++cluster) {
    Add(information, 1, cluster, 0, 1);
    Add(information, 1, cluster, 1, 1);
  }
  const double whole = std::log(2.0);
  const double three_of_four = whole + 0.25 * std::log(0.25) + 0.75 * std::log(0.75);
  const double first = (2.0 * whole + 32.0 * three_of_four) / 70.0;
  const double second = whole / 3.0;
  EXPECT_NEAR(information.ExplainedShare(),
              (8.0 * (whole - first) + 4.0 * (0.0 - second)) /
                  (8.0 * (whole - first) + 4.0 * (whole - second)),
              1e-12);
}

// 25 clusters and 11 classes drawn independently, 60 examples per condition: I / H is above 0.5.
TEST(ClassInformationTest, IndependentClustersOfFewExamplesTellNothing) {
  std::mt19937 random(1);
  double sum = 0.0;
  for (int draw = 0; draw < 50; ++draw) {
    ClassInformation information;
    for (int i = 0; i < 300; ++i) {
      information.Add(i % 5, static_cast<int>(random() % 25), static_cast<int>(random() % 11));
    }
    sum += information.ExplainedShare();
  }
  EXPECT_NEAR(sum / 50.0, 0.0, 0.02);
}

TEST(ClassInformationTest, IsZeroIfNothingIsLeftToTell) {
  EXPECT_DOUBLE_EQ(ClassInformation().ExplainedShare(), 0.0);
  ClassInformation one_class;
  Add(one_class, 0, 0, 2, 3);
  Add(one_class, 0, 1, 2, 3);
  EXPECT_DOUBLE_EQ(one_class.ExplainedShare(), 0.0);
  // As many clusters as examples: they would determine any classes.
  ClassInformation alone;
  for (int i = 0; i < 6; ++i) alone.Add(0, i, i % 2);
  EXPECT_DOUBLE_EQ(alone.ExplainedShare(), 0.0);
}

}  // namespace
}  // namespace maneuver::evaluation::class_information_test
