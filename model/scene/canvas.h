// Antialiased painting into the channels of a picture.
//
// Each channel is painted on a plane of its own, where neighbouring pixels lie side by side and are
// painted eight at a time; Finish brings them together, channels innermost.
//
// Paint covers: a pixel takes max(what it is, coverage * intensity), so neither the order of
// painting nor painting twice matters. Coverage depends on where a shape lies relative to the
// pixel's centre and on nothing else, and fixed-point coordinates are nowhere used: a shape that is
// moved by whole pixels or mirrored gives the same bytes moved or mirrored.

#ifndef MANEUVER_MODEL_SCENE_CANVAS_H_
#define MANEUVER_MODEL_SCENE_CANVAS_H_

#include <cstdint>
#include <span>
#include <vector>

namespace maneuver::scene {

// A place in the picture, pixels: u along a row, v along a column. Pixel (row r, column c) covers
// [c, c+1) x [r, r+1).
struct PixelPoint {
  double u = 0.0;
  double v = 0.0;
};

// Holds the planes and scratch memory: one for each thread. Points may lie anywhere, at any
// distance outside the picture. All zero at first.
class Canvas {
 public:
  Canvas(int height, int width, int channels);

  // Writes what was painted since the last time, and starts anew, all zero.
  //   picture: [height, width, channels] bytes; all of it is written.
  void Finish(std::span<uint8_t> picture);

  // A line of one pixel's width with soft edges: coverage is max(0, 1 - d), d being the distance in
  // pixels from the pixel's centre to the polyline. Points within 0.03 pixels of the chord that
  // leaves them out are left out. Nothing for fewer than two points.
  void DrawPolyline(int channel, std::span<const PixelPoint> points, uint8_t intensity);

  // A disc: coverage is max(0, min(1, radius + 0.5 - d)), d being the distance in pixels from the
  // pixel's centre to `centre`.
  void FillDisc(int channel, const PixelPoint& centre, double radius, uint8_t intensity);

  // A rectangle: coverage is the share of a unit square around the pixel's centre, turned with the
  // rectangle, that lies within it. Where the sides lie along the picture's that is the share of
  // the pixel; at any angle the coverage of all pixels adds up to the rectangle's area.
  //   direction: of the length, a unit vector.
  void FillBox(int channel, const PixelPoint& centre, const PixelPoint& direction,
               double half_length, double half_width, uint8_t intensity);

  // The inside of a simple polygon (convex or not; the last point joins the first): coverage is the
  // exact share of the pixel's area. Nothing for fewer than three points.
  void FillPolygon(int channel, std::span<const PixelPoint> points, uint8_t intensity);

 private:
  void DrawSegment(int channel, PixelPoint a, PixelPoint b, float intensity);
  void AddEdge(PixelPoint a, PixelPoint b, int rows, int columns);
  void AddEdgeInside(float u0, float v0, float u1, float v1, int stride);
  uint8_t* Row(int channel, int row) {
    return &planes_[(static_cast<size_t>(channel) * height_ + row) * stride_];
  }
  // Notes that columns left .. right of rows top .. end-1 are painted, padding included.
  void Touch(int channel, int top, int end, int left, int right) {
    const int first = left >> block_bits_;
    const uint64_t blocks = ((uint64_t{2} << (right >> block_bits_)) - 1) >> first << first;
    uint64_t* touched = &touched_[static_cast<size_t>(top) * channels_ + channel];
    for (int row = top; row < end; ++row, touched += channels_) *touched |= blocks;
  }
  // Moves those blocks of a row to where its pixels lie `channels` apart, and leaves zeros.
  void MoveBlocks(uint64_t blocks, uint8_t* row, uint8_t* to) const;

  const int height_;
  const int width_;
  const int channels_;
  // From one row of a plane to the next: as many pixels as are painted at a time lie beyond the
  // last one that is seen, so that nobody has to stop there.
  const int stride_;
  const int block_bits_;         // a block is 2^block_bits_ pixels of a row, of which there are 64
  std::vector<uint8_t> planes_;  // [channels, height, stride]; zero but where touched
  std::vector<uint64_t> touched_;  // [height, channels]: a bit for each block
  std::vector<uint8_t> sides_;     // of a polyline's points
  // Signed area that each pixel gains over its left neighbour; all zero between calls.
  std::vector<float> area_gain_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_CANVAS_H_
