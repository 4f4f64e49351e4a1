// Evaluates the convolutional layers: the first ones by our own convolutions while a raster is
// mostly zero (leading_layers.h), the others by oneDNN.

#ifndef MANEUVER_MODEL_INFERENCE_BACKBONE_H_
#define MANEUVER_MODEL_INFERENCE_BACKBONE_H_

#include <cstddef>
#include <cstdint>
#include <memory>

#include "maneuver/v1/model_spec.pb.h"
#include "model/artifact/tensor.h"
#include "model/scene/raster.h"

namespace maneuver::inference {

// Returns whether this processor computes with bf16 (AVX-512 BF16 or AMX).
bool ProcessorHasBf16();

// Convolutions with batch normalisation folded into their weights; ReLU and the sums of residual
// blocks are fused. Each primitive evaluates one raster, so an answer cannot depend on the batch.
// Immutable; safe to share between threads.
//
// oneDNN reports errors by exceptions: the constructor may throw dnnl::error (a std::exception).
class Backbone {
 public:
  // Memory that evaluation writes to. Each thread needs its own.
  class Scratch;
  struct ScratchDeleter {
    void operator()(Scratch* scratch) const;
  };
  using ScratchPointer = std::unique_ptr<Scratch, ScratchDeleter>;

  Backbone(const v1::ModelSpec& spec, const artifact::TensorMap& weights, bool bf16);
  ~Backbone();
  Backbone(const Backbone&) = delete;
  Backbone& operator=(const Backbone&) = delete;

  // Returns the memory of the packed weights, bytes.
  size_t bytes() const;
  // Makes a scratch. This backbone must outlive it.
  ScratchPointer NewScratch() const;

  // Evaluates the layers on the calling thread.
  //   raster: 255 stands for 1
  //   grid: [h, w, C'] the last layer's output (a residual network's is [1, 1, C'])
  void Evaluate(const scene::Raster& raster, Scratch* scratch, float* grid) const;

 private:
  struct Layers;
  std::unique_ptr<const Layers> layers_;
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_BACKBONE_H_
