// The raster of a scene, and a record of which of its pixels may be nonzero. Most pixels are zero:
// they need not be cleared before the next scene is drawn, and readers can skip them.

#ifndef MANEUVER_MODEL_SCENE_RASTER_H_
#define MANEUVER_MODEL_SCENE_RASTER_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::scene {

// A set of blocks of neighbouring pixels in one row: one bit per block, the leftmost block lowest.
using PixelBlocks = uint64_t;

// Each channel has its own plane: neighbouring pixels of a row are neighbouring bytes.
class Raster {
 public:
  // The number of pixels that are painted or read at a time. Rows are padded at their end, so that
  // a vector may run over the last pixel. The padding has no meaning.
  static constexpr int kLanes = 8;

  // Makes a raster whose pixels are all 0.
  Raster(int height, int width, int channels);

  int height() const { return height_; }
  int width() const { return width_; }
  int channels() const { return channels_; }
  // Returns H * W * C.
  size_t values() const { return static_cast<size_t>(height_) * width_ * channels_; }

  // Returns the pixels of one row of one channel.
  const uint8_t* Row(int channel, int row) const { return &planes_[RowPlace(channel, row)]; }
  // Returns them for writing. Whoever writes must call MarkNonzero for the blocks written.
  uint8_t* Row(int channel, int row) { return &planes_[RowPlace(channel, row)]; }
  // Returns the distance in bytes from one row of a channel to the next.
  ptrdiff_t stride() const { return stride_; }

  // Returns the blocks of a row of a channel that may hold nonzero pixels. A block has
  // block_pixels() pixels, a multiple of kLanes.
  PixelBlocks NonzeroBlocks(int channel, int row) const {
    return nonzero_[static_cast<size_t>(row) * channels_ + channel];
  }
  int block_pixels() const { return 1 << block_bits_; }
  // Returns the block that contains a column, as the number of its bit.
  int BlockOf(int column) const { return column >> block_bits_; }
  // Returns the blocks that contain columns left .. right. `right` may lie in the row's padding.
  PixelBlocks BlocksOf(int left, int right) const {
    const int first = left >> block_bits_;
    return ((PixelBlocks{2} << (right >> block_bits_)) - 1) >> first << first;
  }
  // Records that these blocks of a row may hold nonzero pixels.
  void MarkNonzero(int channel, int row, PixelBlocks blocks) {
    nonzero_[static_cast<size_t>(row) * channels_ + channel] |= blocks;
  }

  // Sets all pixels to 0.
  void Clear();

  // Turns the raster upside down: mirrors it about the target's x axis.
  void Mirror();

  // Writes the pixels with the channels innermost.
  //   bytes: [H, W, C], row-major; all of it is written.
  void WriteInterleaved(std::span<uint8_t> bytes) const;

 private:
  size_t RowPlace(int channel, int row) const {
    return (static_cast<size_t>(channel) * height_ + row) * stride_;
  }

  int height_;
  int width_;
  int channels_;
  int stride_;
  int block_bits_;
  std::vector<uint8_t> planes_;  // [C, H, stride] plus padding; 0 outside the blocks in nonzero_
  std::vector<PixelBlocks> nonzero_;  // [H, C]
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_RASTER_H_
