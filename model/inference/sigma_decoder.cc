#include "model/inference/sigma_decoder.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace maneuver::inference {

SigmaDecoder::SigmaDecoder(const artifact::TensorMap& weights) {
  for (int i = 0;; ++i) {
    const auto found = weights.find(absl::StrCat("decoder.", i, ".weight"));
    if (found == weights.end()) return;
    const artifact::Tensor& weight = found->second;
    const int outputs = static_cast<int>(weight.shape[0]);
    const int inputs = static_cast<int>(weight.shape[1]);
    if (i == 0) {
      first_ = Eigen::Map<const Rows>(weight.values.data(), outputs, inputs).transpose();
    } else {
      layers_.emplace_back(inputs, outputs, weight.values.data());
    }
  }
}

size_t SigmaDecoder::bytes() const {
  size_t bytes = static_cast<size_t>(first_.size()) * sizeof(float);
  for (const kernels::DifferenceLayer& layer : layers_) bytes += layer.bytes();
  return bytes;
}

void SigmaDecoder::Decode(const Mlp& decoder, const Rows& means, const Rows& stddevs,
                          MlpScratch* mlp_scratch, SigmaScratch* scratch, Rows* images) const {
  const Eigen::Index actions = means.rows();
  const Eigen::Index pairs = means.cols();
  const auto size_of = [](Eigen::Index rows, Eigen::Index columns) {
    return static_cast<size_t>(rows) * static_cast<size_t>(columns);
  };
  // After the first layer h is exact, and q is 0.
  Eigen::Index width = first_.cols();
  scratch->front.resize(size_of(2 * actions * pairs, width));
  for (Eigen::Index n = 0; n < actions; ++n) {
    Eigen::Map<Rows> rows(scratch->front.data() + 2 * n * pairs * width, 2 * pairs, width);
    rows.topRows(pairs) = stddevs.row(n).transpose().asDiagonal() * first_;
    rows.bottomRows(pairs).setZero();
  }
  scratch->centers.resize(size_of(actions, width));
  decoder.layers().front().Apply(means.data(), static_cast<int>(actions), Activation::kNone,
                                 &mlp_scratch->dense, scratch->centers.data());
  std::vector<float>& centers = mlp_scratch->front;
  for (size_t i = 0; i < layers_.size(); ++i) {
    for (Eigen::Index n = 0; n < actions; ++n) {
      float* const h = scratch->front.data() + 2 * n * pairs * width;
      kernels::RectifyDifferences(static_cast<int>(width), static_cast<int>(pairs),
                                  scratch->centers.data() + n * width, h, h + pairs * width);
    }
    const Eigen::Index outputs = layers_[i].outputs();
    scratch->back.resize(size_of(2 * actions * pairs, outputs));
    // At first q is 0 in most inputs, so it goes apart from h.
    const Eigen::Index together = i == 0 ? pairs : 2 * pairs;
    for (Eigen::Index row = 0; row < 2 * actions * pairs; row += together) {
      layers_[i].Apply(scratch->front.data() + row * width, static_cast<int>(together),
                       &scratch->differences, scratch->back.data() + row * outputs);
    }
    std::swap(scratch->front, scratch->back);
    centers.resize(size_of(actions, outputs));
    decoder.layers()[i + 1].Apply(scratch->centers.data(), static_cast<int>(actions),
                                  Activation::kNone, &mlp_scratch->dense, centers.data());
    std::swap(centers, scratch->centers);
    width = outputs;
  }
  images->resize(actions * (2 * pairs + 1), width);
  for (Eigen::Index n = 0; n < actions; ++n) {
    const Eigen::Map<const Eigen::RowVectorXf> center(scratch->centers.data() + n * width, width);
    const Eigen::Map<const Rows> rows(scratch->front.data() + 2 * n * pairs * width, 2 * pairs,
                                      width);
    Eigen::Index row = n * (2 * pairs + 1);
    images->row(row) = center;
    for (Eigen::Index d = 0; d < pairs; ++d) {
      images->row(++row) = center + rows.row(pairs + d) + rows.row(d);
      images->row(++row) = center + rows.row(pairs + d) - rows.row(d);
    }
  }
}

}  // namespace maneuver::inference
