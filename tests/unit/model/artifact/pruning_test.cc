#include "model/artifact/pruning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "model/artifact/model_spec.h"
#include "tests/unit/model/artifact/tiny_model.h"

namespace maneuver::artifact::pruning_test {
namespace {

using testing::ElementsAre;
using testing::FloatEq;

TEST(PruningTest, KeepsTheRowsOfTheActionsInTheOrderGiven) {
  StoredModel model = TinyModel();
  model.weights["mixture.mean"].values = {1, 2, 3, 4, 5, 6};  // [3, 2]
  model.manifest.add_actions();
  (*model.manifest.mutable_metrics())["nll"] = 1.0;
  const auto pruned = PruneActions(model, std::vector<int>{2, 0});
  ASSERT_TRUE(pruned.ok()) << pruned.status();
  EXPECT_THAT(pruned->weights.at("mixture.mean").values, ElementsAre(5, 6, 1, 2));
  EXPECT_EQ(pruned->manifest.spec().actions(), 2);
  EXPECT_EQ(pruned->manifest.actions_size(), 0);
  EXPECT_TRUE(pruned->manifest.metrics().empty());
}

TEST(PruningTest, EveryTensorHasTheShapeOfTheSmallerModel) {
  const auto pruned = PruneActions(TinyModel(), std::vector<int>{0, 2});
  ASSERT_TRUE(pruned.ok());
  const auto shapes = TensorShapes(pruned->manifest.spec());
  ASSERT_EQ(pruned->weights.size(), shapes.size());
  for (const auto& [name, shape] : shapes) {
    EXPECT_EQ(pruned->weights.at(name).shape, shape) << name;
    int64_t count = 1;
    for (const int64_t size : shape) count *= size;
    EXPECT_EQ(static_cast<int64_t>(pruned->weights.at(name).values.size()), count) << name;
  }
  // Tensors that do not count actions are unchanged.
  EXPECT_EQ(pruned->weights.at("decoder.0.weight").values,
            TinyModel().weights.at("decoder.0.weight").values);
  EXPECT_EQ(pruned->weights.at("action_predictor.0.weight").values,
            TinyModel().weights.at("action_predictor.0.weight").values);
}

TEST(PruningTest, WeightsOfTheMixtureAreRenormalised) {
  StoredModel model = TinyModel();
  model.weights["mixture.log_weight"].values = {std::log(0.5f), std::log(0.2f), std::log(0.3f)};
  const auto pruned = PruneActions(model, std::vector<int>{0, 2});
  ASSERT_TRUE(pruned.ok());
  EXPECT_THAT(pruned->weights.at("mixture.log_weight").values,
              ElementsAre(FloatEq(std::log(0.625f)), FloatEq(std::log(0.375f))));
}

TEST(PruningTest, RefusesUnknownRepeatedOrTooFewActions) {
  for (const std::vector<int>& kept :
       {std::vector<int>{0, 3}, {-1, 0}, {1, 1}, {2}, std::vector<int>{}}) {
    EXPECT_EQ(PruneActions(TinyModel(), kept).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace maneuver::artifact::pruning_test
