#include "model/artifact/pruning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numeric>
#include <vector>

#include "model/artifact/model_spec.h"
#include "model/artifact/model_weights.h"
#include "model/artifact/training_presets.h"
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

TEST(PruningTest, ModelOfThePresetLanesStaysComplete) {
  StoredModel model;
  *model.manifest.mutable_spec() = ResolveTrainingSettings({}).model();
  ASSERT_TRUE(model.manifest.spec().has_action_geometry());
  for (const auto& [name, shape] : TensorShapes(model.manifest.spec())) {
    Tensor& tensor = model.weights[name];
    tensor.shape = shape;
    const int64_t count =
        std::accumulate(shape.begin(), shape.end(), int64_t{1}, std::multiplies());
    tensor.values.assign(static_cast<size_t>(count), 0.5f);
  }
  const auto biases_of = [](StoredModel& of) -> std::vector<float>& {
    return of.weights.at("action_geometry.joint_action.bias").values;
  };
  const size_t width = biases_of(model).size() / 25;
  biases_of(model)[7 * width] = 7.0f;

  auto pruned = PruneActions(model, std::vector<int>{3, 7, 0});
  ASSERT_TRUE(pruned.ok()) << pruned.status();
  EXPECT_EQ(FindWeightFault(pruned->manifest.spec(), pruned->weights), "");
  EXPECT_EQ(biases_of(*pruned)[1 * width], 7.0f);
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
