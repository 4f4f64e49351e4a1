#include "model/evaluation/measured_set.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "tests/unit/model/evaluation/report_of.h"

namespace maneuver::evaluation::measured_set_test {
namespace {

constexpr int kActions = 4;

Eigen::VectorXd Distribution(std::mt19937_64& random) {
  std::gamma_distribution<double> gamma(0.5);
  Eigen::VectorXd p(kActions);
  for (double& value : p) value = gamma(random) + 1e-6;
  return p / p.sum();
}

// Random actions, whose classes depend on them a little.
Measurement Draw(std::mt19937_64& random) {
  Measurement measured;
  measured.probabilities = Distribution(random);
  measured.responsibilities = Distribution(random);
  Eigen::Index action = 0;
  measured.responsibilities.maxCoeff(&action);
  measured.action = static_cast<int>(action);
  measured.keys.speed = static_cast<double>(random() % 20);
  const auto label = [&] {
    return static_cast<int>(random() % 3 == 0 ? random() % kActions
                                              : static_cast<uint64_t>(action));
  };
  measured.keys.kinematic_class = static_cast<KinematicClass>(label());
  measured.relative_class = static_cast<RelativeClass>(label());
  measured.maneuver = label();
  measured.covernet.emplace().probabilities = Distribution(random);
  measured.multipath.emplace().probabilities = Distribution(random);
  return measured;
}

TEST(MeasuredSetTest, TheMetricsWithoutABlockOfGroupsAreThoseOfTheOtherExamples) {
  // 107 is in the block of 7, and 4 has no example.
  const std::vector<int> groups = {7, 3, 107, 9, 4};
  const std::vector<int> recordings = {2, 0, 1, 3};
  std::mt19937_64 random(1);
  MeasuredSetBuilder builder(groups);
  std::vector<std::pair<int, Measurement>> all;  // block
  for (int block = 0; block < 3; ++block) {
    MeasuredExamples examples;
    for (int i = 0; i < 40; ++i) {
      examples.examples.emplace_back().recording = i % 4;
      examples.measured.push_back(Draw(random));
      const int recording = recordings[static_cast<size_t>(i) % 4];
      all.emplace_back(groups[static_cast<size_t>(recording)] % 100, examples.measured.back());
    }
    builder.Add(examples, recordings);
  }
  const v1::MeasuredSet set = std::move(builder).Build();
  EXPECT_EQ(set.examples_size(), 120);
  ASSERT_EQ(set.without_size(), 3);
  const auto expect_as_of = [&](const auto& metrics, int left_out) {
    std::vector<Measurement> rest;
    for (const auto& [block, measured] : all) {
      if (block != left_out) rest.push_back(measured);
    }
    const v1::EvaluationReport report = ReportOf(rest, false);
    for (const auto& [name, value] : metrics) {
      EXPECT_NEAR(value, report.metrics().at(name), 1e-12) << name << " without " << left_out;
    }
    return static_cast<int64_t>(rest.size());
  };
  expect_as_of(set.set_metrics(), -1);
  for (const char* name : {"mutual_information", "effective_actions", "nmi", "purity_kinematic",
                           "class_information_relative", "named_share_motion",
                           "covernet_action_perplexity", "multipath_mutual_information"}) {
    EXPECT_TRUE(set.set_metrics().contains(name)) << name;
  }
  std::set<int> seen;
  for (const v1::SetWithoutBlock& without : set.without()) {
    seen.insert(without.block());
    EXPECT_EQ(without.set_metrics_size(), set.set_metrics_size());
    EXPECT_EQ(expect_as_of(without.set_metrics(), without.block()), without.examples());
  }
  EXPECT_EQ(seen, std::set<int>({3, 7, 9}));
}

TEST(MeasuredSetTest, NothingIsLeftWithoutTheOnlyGroup) {
  std::mt19937_64 random(2);
  MeasuredExamples examples;
  examples.examples.emplace_back().recording = 0;
  examples.measured.push_back(Draw(random));
  MeasuredSetBuilder builder({5});
  builder.Add(examples, std::vector<int>{0});
  const v1::MeasuredSet set = std::move(builder).Build();
  ASSERT_EQ(set.without_size(), 1);
  EXPECT_EQ(set.without(0).examples(), 0);
  EXPECT_TRUE(set.without(0).set_metrics().empty());
}

}  // namespace
}  // namespace maneuver::evaluation::measured_set_test
