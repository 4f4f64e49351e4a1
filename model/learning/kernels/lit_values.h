// The values of rasters that are not black, and what a convolution makes of them.

#ifndef MANEUVER_MODEL_LEARNING_KERNELS_LIT_VALUES_H_
#define MANEUVER_MODEL_LEARNING_KERNELS_LIT_VALUES_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace maneuver::learning {

// A square kernel of odd size, padded by half of it, over [height, width, channels].
struct ConvolutionShape {
  int64_t height = 0;
  int64_t width = 0;
  int64_t channels = 0;
  int64_t outputs = 0;  // channels of the output
  int64_t kernel = 0;
  int64_t stride = 0;

  int64_t output_height() const { return (height - 1) / stride + 1; }
  int64_t output_width() const { return (width - 1) / stride + 1; }
};

// A raster's values that are not black. Of scenes a twelfth of them: few lines are near, and few
// agents.
class LitValues {
 public:
  //   raster: [height, width, channels]
  LitValues(const ConvolutionShape& shape, const uint8_t* raster);

  size_t size() const { return values_.size(); }

  // The convolution's output.
  //   weight: [kernel, kernel, channels, VectorMultiple(outputs)], divided by full intensity
  //   output: [output_height, output_width, outputs]
  void Convolve(const ConvolutionShape& shape, const float* weight, float* output) const;

  // Adds to the gradient of `weight`, laid out likewise, what that of the output makes of it.
  //   gradient: of the output, laid out as it
  void AddWeightGradient(const ConvolutionShape& shape, const float* gradient,
                         float* weight_gradient) const;

  // Rounded up to whole vectors.
  static int64_t VectorMultiple(int64_t outputs);

 private:
  // Of each row, in the order of their places: place in the row (pixel and channel) << 8 | value.
  std::vector<uint32_t> values_;
  // [height, width + 1] where in values_ a pixel's begin; the row's end.
  std::vector<uint32_t> begins_;
};

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_KERNELS_LIT_VALUES_H_
