#include "model/inference/anchor_model.h"

#include <gtest/gtest.h>

#include "model/artifact/anchor_baselines.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::inference::anchor_model_test {
namespace {

// Of three waypoints: actions 0, 1 and 2 stay 0, 1 and 2 m to the left.
class AnchorModelTest : public testing::Test {
 protected:
  AnchorModelTest() {
    const v1::ModelSpec spec = artifact::AnchorSpec(artifact::TinySpec());
    artifact::TensorMap weights = RandomModel(spec, 1).weights;
    artifact::Tensor& mean = weights["anchors.mean"];
    mean.shape = {3, 3, 2};
    artifact::Tensor& covariance = weights["anchors.covariance"];
    covariance.shape = {3, 3, 3};
    for (int k = 0; k < 3; ++k) {
      for (int t = 0; t < 3; ++t) {
        mean.values.insert(mean.values.end(), {0.0F, static_cast<float>(k)});
        covariance.values.insert(covariance.values.end(), {1.0F, 0.0F, 2.0F});
      }
    }
    auto model = AnchorModel::Make(spec, weights, {Precision::kF32});
    EXPECT_TRUE(model.ok()) << model.status();
    model_ = *std::move(model);
    reference_.resize(3, 2);
    reference_ << 10.0, 0.0, 20.0, -1.0, 30.0, -2.0;
  }

  std::shared_ptr<const AnchorModel> model_;
  Trajectory reference_;
  MlpScratch scratch_;
};

TEST_F(AnchorModelTest, AddsTheReferenceToItsAnchors) {
  SceneEncoding encoding;
  encoding.reference = reference_;
  const auto distributions = model_->Describe(encoding, &scratch_);
  ASSERT_EQ(distributions.size(), 3U);
  for (int k = 0; k < 3; ++k) {
    const auto& own = distributions[static_cast<size_t>(k)];
    for (int t = 0; t < 3; ++t) {
      EXPECT_EQ(own.moment_mean(t, 0), reference_(t, 0));
      EXPECT_EQ(own.moment_mean(t, 1), reference_(t, 1) + k);
      EXPECT_EQ(own.mean()(t, 1), reference_(t, 1) + k);
      EXPECT_EQ(own.moment_covariance(t, 2), 2.0);
    }
  }
}

TEST_F(AnchorModelTest, AnswersItsAnchorsWithoutAReference) {
  const auto distributions = model_->Describe({}, &scratch_);
  EXPECT_EQ(distributions[2].moment_mean(1, 0), 0.0);
  EXPECT_EQ(distributions[2].moment_mean(1, 1), 2.0);
}

TEST_F(AnchorModelTest, FindsTheNearestAnchorRelativeToTheReference) {
  SceneEncoding encoding;
  encoding.reference = reference_;
  Trajectory driven = reference_;
  driven.col(1).array() += 1.9;
  EXPECT_EQ(model_->Nearest(encoding, driven), 2);
  EXPECT_EQ(model_->Nearest({}, Trajectory::Constant(3, 2, 0.4)), 0);
  EXPECT_EQ(model_->Nearest({}, Trajectory::Constant(3, 2, 0.6)), 1);
}

}  // namespace
}  // namespace maneuver::inference::anchor_model_test
