// A scene's picture, and where it is black: most of it is, and need neither be cleared before the
// next scene is drawn nor be looked at by those who read it.

#ifndef MANEUVER_MODEL_SCENE_RASTER_H_
#define MANEUVER_MODEL_SCENE_RASTER_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::scene {

// Some of a row's blocks of neighbouring pixels: a bit for each, the leftmost the lowest.
using PixelBlocks = uint64_t;

// Each channel lies on a plane of its own: neighbouring pixels of a row are neighbouring bytes.
class Raster {
 public:
  // So many pixels are painted or read at a time: rows go on behind their last pixel, so that
  // nobody has to stop there. What lies behind it is never seen.
  static constexpr int kLanes = 8;

  // All black.
  Raster(int height, int width, int channels);

  int height() const { return height_; }
  int width() const { return width_; }
  int channels() const { return channels_; }
  // H * W * C.
  size_t values() const { return static_cast<size_t>(height_) * width_ * channels_; }

  // The pixels of a row of a channel.
  const uint8_t* Row(int channel, int row) const { return &planes_[RowPlace(channel, row)]; }
  // Who writes there says so by Touch.
  uint8_t* Row(int channel, int row) { return &planes_[RowPlace(channel, row)]; }
  // From a row of a channel to its next one.
  ptrdiff_t stride() const { return stride_; }

  // The blocks of a row of a channel that may be anything but black. A block is block_pixels()
  // pixels, a multiple of kLanes.
  PixelBlocks Touched(int channel, int row) const {
    return touched_[static_cast<size_t>(row) * channels_ + channel];
  }
  int block_pixels() const { return 1 << block_bits_; }
  // The block that a pixel of a row is in: which bit it is.
  int BlockOf(int column) const { return column >> block_bits_; }
  // Those of columns left .. right; `right` may be as far behind the last pixel as the row goes.
  PixelBlocks BlocksOf(int left, int right) const {
    const int first = left >> block_bits_;
    return ((PixelBlocks{2} << (right >> block_bits_)) - 1) >> first << first;
  }
  // Notes that blocks of a row are painted.
  void Touch(int channel, int row, PixelBlocks blocks) {
    touched_[static_cast<size_t>(row) * channels_ + channel] |= blocks;
  }

  // Makes all of it black again.
  void Clear();

  // To bytes where each pixel's channels are neighbours.
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
  std::vector<uint8_t> planes_;       // [C, H, stride], and room behind; 0 but where touched
  std::vector<PixelBlocks> touched_;  // [H, C]
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_RASTER_H_
