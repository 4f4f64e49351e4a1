// Finds the nonzero values of a raster and convolves them: for training, where weights change in
// every step and get gradients.

#ifndef MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_
#define MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_

#include <cstddef>
#include <cstdint>
#include <vector>

namespace maneuver::kernels {

// Outputs are padded to a multiple of this number.
inline constexpr int64_t kNonzeroPadding = 8;

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

// Sets bit i of `words` where byte i is not 0.
//   words: [ceil(count / 64)], all of which is written
void FindNonzeroBytes(const uint8_t* bytes, size_t count, uint64_t* words);

// The nonzero values of a raster. They are a twelfth of a typical scene's values, because few lines
// and agents are near. All instruction sets give the same bits.
class NonzeroValues {
 public:
  //   raster: [height, width, channels]
  NonzeroValues(const ConvolutionShape& shape, const uint8_t* raster);

  size_t size() const { return values_.size(); }

  // Writes the convolution's output.
  //   weight: [kernel, kernel, channels, VectorMultiple(outputs)], divided by full intensity
  //   output: [output_height, output_width, outputs]
  void Convolve(const ConvolutionShape& shape, const float* weight, float* output) const;

  // Accumulates dL/dweight from dL/doutput. `weight_gradient` is laid out as the weight.
  //   gradient: dL/doutput, in the layout of the output
  void AddWeightGradient(const ConvolutionShape& shape, const float* gradient,
                         float* weight_gradient) const;

  // Returns `outputs` rounded up to whole vectors.
  static int64_t VectorMultiple(int64_t outputs);

 private:
  // One number for each value, row by row and ordered by place: (place << 8) | value. The place is
  // the index of pixel and channel in the row.
  std::vector<uint32_t> values_;
  // [height, width + 1] index into values_ where each pixel's values begin, then where the row
  // ends.
  std::vector<uint32_t> begins_;
};

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_NONZERO_CONVOLUTION_H_
