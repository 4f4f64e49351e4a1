#include "model/evaluation/cost_text.h"

#include <gtest/gtest.h>

namespace maneuver::evaluation::cost_text_test {
namespace {

TEST(CostTextTest, CountsHaveThreeDigitsAndAUnit) {
  v1::ModelCost cost;
  cost.set_backbone_parameters(24'557'032);
  cost.set_parameters(999'600);
  cost.set_backbone_multiply_adds(5'074'000'000);
  cost.set_predictor_multiply_adds(6'000'000);
  cost.set_distribution_multiply_adds(850);
  EXPECT_EQ(BackboneCostText(cost), "24.6 M parameters, 5.07 G multiply-adds a target");
  EXPECT_EQ(ModelCostText(cost),
            "1.00 M parameters; multiply-adds: 5.08 G for p(y|s), 850 for each action described");
  cost.set_vector_multiply_adds(20'000'000);
  EXPECT_EQ(ModelCostText(cost),
            "1.00 M parameters; multiply-adds: 5.10 G for p(y|s), 850 for each action described");
  cost.set_backbone_parameters(99'960);
  cost.set_backbone_multiply_adds(9'996);
  EXPECT_EQ(BackboneCostText(cost), "100 k parameters, 10.0 k multiply-adds a target");
}

}  // namespace
}  // namespace maneuver::evaluation::cost_text_test
