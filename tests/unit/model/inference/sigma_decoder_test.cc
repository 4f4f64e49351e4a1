#include "model/inference/sigma_decoder.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "model/artifact/tensor.h"
#include "model/inference/stored_layers.h"
#include "model/probability/sigma_points.h"

namespace maneuver::inference::sigma_decoder_test {
namespace {

using Rows = SigmaDecoder::Rows;

constexpr int kDimensions = 5;

// A decoder with these widths: random weights, so that each layer keeps the size of its inputs.
artifact::TensorMap RandomDecoder(const std::vector<int>& widths, float bias_mean) {
  std::mt19937 random(11);
  std::normal_distribution<float> normal;
  artifact::TensorMap weights;
  for (size_t i = 0; i + 1 < widths.size(); ++i) {
    const float scale = std::sqrt(2.0F / static_cast<float>(widths[i]));
    artifact::Tensor weight;
    weight.shape = {widths[i + 1], widths[i]};
    weight.values.resize(static_cast<size_t>(widths[i] * widths[i + 1]));
    for (float& value : weight.values) value = scale * normal(random);
    artifact::Tensor bias;
    bias.shape = {widths[i + 1]};
    bias.values.resize(static_cast<size_t>(widths[i + 1]));
    for (float& value : bias.values) value = bias_mean + 0.3F * normal(random);
    weights[absl::StrCat("decoder.", i, ".weight")] = weight;
    weights[absl::StrCat("decoder.", i, ".bias")] = bias;
  }
  return weights;
}

Rows RandomRows(int rows, float mean, float spread) {
  std::mt19937 random(5);
  std::normal_distribution<float> normal(mean, spread);
  Rows values(rows, kDimensions);
  for (Eigen::Index r = 0; r < values.rows(); ++r) {
    for (Eigen::Index c = 0; c < values.cols(); ++c) values(r, c) = normal(random);
  }
  return values;
}

// The sigma points themselves, decoded in f32.
Rows DecodeEach(const Mlp& decoder, const Rows& means, const Rows& stddevs) {
  const Eigen::Index points = 2 * means.cols() + 1;
  Rows latents(means.rows() * points, means.cols());
  for (Eigen::Index n = 0; n < means.rows(); ++n) {
    latents.middleRows(n * points, points) =
        probability::SigmaPoints(means.row(n).transpose().cast<double>(),
                                 stddevs.row(n).transpose().cast<double>())
            .cast<float>();
  }
  Rows images(latents.rows(), decoder.outputs());
  MlpScratch scratch;
  decoder.Apply(latents.data(), static_cast<int>(latents.rows()), &scratch, images.data());
  return images;
}

class SigmaDecoderTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!SigmaDecoder::Supported()) GTEST_SKIP() << "the processor has no bf16";
  }

  static Rows Decode(const artifact::TensorMap& weights, const Rows& means, const Rows& stddevs) {
    MlpScratch mlp_scratch;
    SigmaScratch scratch;
    Rows images;
    SigmaDecoder(weights).Decode(StoredMlp(weights, "decoder", false), means, stddevs, &mlp_scratch,
                                 &scratch, &images);
    return images;
  }
};

TEST_F(SigmaDecoderTest, DecodesWhatEachPointIsDecodedTo) {
  for (const std::vector<int>& widths : {std::vector<int>{kDimensions, 100},
                                         {kDimensions, 64, 60},
                                         {kDimensions, 128, 128, 128, 100}}) {
    const auto weights = RandomDecoder(widths, 0.0F);
    const Rows means = RandomRows(4, 0.0F, 1.0F);
    const Rows stddevs = RandomRows(4, 0.2F, 0.05F);
    const Rows expected = DecodeEach(StoredMlp(weights, "decoder", false), means, stddevs);
    const Rows images = Decode(weights, means, stddevs);
    ASSERT_EQ(images.rows(), expected.rows());
    ASSERT_EQ(images.cols(), expected.cols());
    const Eigen::Index points = 2 * kDimensions + 1;
    for (Eigen::Index r = 0; r < images.rows(); ++r) {
      const Eigen::Index center = r / points * points;
      if (r == center) {
        EXPECT_EQ(images.row(r), expected.row(r)) << "the mean is decoded in f32";
        continue;
      }
      const float size = (expected.row(r) - expected.row(center)).norm();
      EXPECT_GT(size, 0.1F);
      // bf16 has 8 bits; errors of many products average out.
      EXPECT_LT((images.row(r) - expected.row(r)).norm(), 0.01F * size)
          << "row " << r << ", " << widths.size() - 1 << " layers";
    }
  }
}

TEST_F(SigmaDecoderTest, MovesNoMeanWhereTheDecoderIsLinear) {
  // Biases far above 0: no ReLU cuts anything off.
  const auto weights = RandomDecoder({kDimensions, 32, 32, 20}, 50.0F);
  auto positive = weights;
  for (auto& [name, tensor] : positive) {
    for (float& value : tensor.values) value = std::abs(value);
  }
  const Rows images = Decode(positive, RandomRows(2, 3.0F, 0.1F), RandomRows(2, 0.1F, 0.01F));
  for (Eigen::Index n = 0; n < 2; ++n) {
    const Eigen::Index center = n * (2 * kDimensions + 1);
    for (Eigen::Index d = 0; d < kDimensions; ++d) {
      const Eigen::RowVectorXf middle =
          0.5F * (images.row(center + 1 + 2 * d) + images.row(center + 2 + 2 * d));
      EXPECT_LT((middle - images.row(center)).norm(), 1e-6F * images.row(center).norm());
    }
  }
}

TEST_F(SigmaDecoderTest, KeepsTheBitsOfAnActionAloneAndWithOthers) {
  const auto weights = RandomDecoder({kDimensions, 128, 128, 100}, 0.0F);
  const Rows means = RandomRows(7, 0.0F, 1.0F);
  const Rows stddevs = RandomRows(7, 0.2F, 0.05F);
  const Rows together = Decode(weights, means, stddevs);
  const Eigen::Index points = 2 * kDimensions + 1;
  for (Eigen::Index n = 0; n < means.rows(); ++n) {
    EXPECT_EQ(Decode(weights, means.row(n), stddevs.row(n)),
              together.middleRows(n * points, points));
  }
}

}  // namespace
}  // namespace maneuver::inference::sigma_decoder_test
