// Decodes the sigma points of actions, each pair relative to the point between them.
//
// The images of sigma points (probability/sigma_points.h) are needed for their differences above
// all: these are the covariance, and the means differ from the image of the mean by little. So the
// mean is decoded in f32, and the pairs beside it as differences in bf16
// (kernels/difference_layer.h). A processor multiplies twice as many numbers of bf16 at a time.

#ifndef MANEUVER_MODEL_INFERENCE_SIGMA_DECODER_H_
#define MANEUVER_MODEL_INFERENCE_SIGMA_DECODER_H_

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "model/artifact/tensor.h"
#include "model/inference/mlp.h"
#include "model/kernels/difference_layer.h"

namespace maneuver::inference {

// Scratch of a decoder. Each thread needs its own.
struct SigmaScratch {
  kernels::DifferenceScratch differences;
  std::vector<float> front;  // [N, 2D, H] of each action the rows h, then the rows q
  std::vector<float> back;
  std::vector<float> centers;  // [N, H]
};

// Immutable; safe to share between threads. An action's images have the same bits, whichever
// actions are decoded with it.
class SigmaDecoder {
 public:
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  // Returns whether the kernels in use can.
  static bool Supported() { return kernels::DifferenceLayer::Supported(); }

  // Packs the layers `decoder.0`, `decoder.1` and so on.
  explicit SigmaDecoder(const artifact::TensorMap& weights);

  size_t bytes() const;

  // Decodes the sigma points of N Gaussians in latent space.
  //   decoder: the same layers in f32
  //   means, stddevs: [N, D]
  //   images: [N (2D+1), outputs], of each Gaussian in the order of probability::SigmaPoints
  void Decode(const Mlp& decoder, const Rows& means, const Rows& stddevs, MlpScratch* mlp_scratch,
              SigmaScratch* scratch, Rows* images) const;

 private:
  Rows first_;  // [D, H] what one unit of each latent dimension adds after the first layer
  std::vector<kernels::DifferenceLayer> layers_;  // all but the first
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_SIGMA_DECODER_H_
