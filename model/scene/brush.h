// Antialiased painting into the channels of a raster, eight neighbouring pixels at a time.
//
// Painting never darkens: a pixel becomes max(its value, coverage * intensity). The order of
// painting does not matter, nor does painting twice. Coverage depends only on where a shape lies
// relative to the pixel's centre, in floating point. So a shape that is moved by whole pixels or
// mirrored gives the same bytes, moved or mirrored.

#ifndef MANEUVER_MODEL_SCENE_BRUSH_H_
#define MANEUVER_MODEL_SCENE_BRUSH_H_

#include <cstdint>
#include <span>
#include <vector>

#include "model/kernels/points.h"
#include "model/kernels/raster_paint.h"
#include "model/scene/pixel_line.h"
#include "model/scene/raster.h"

namespace maneuver::scene {

// Holds scratch memory: use one per thread. Points may lie anywhere, at any distance outside the
// picture.
class Brush {
 public:
  // Draws a line one pixel wide with soft edges. Coverage is max(0, 1 - d), where d is the distance
  // in pixels from the pixel's centre to the polyline. May skip points that lie within 0.03 pixels
  // of the chord that replaces them. Draws nothing for fewer than two points.
  void DrawPolyline(Raster* raster, int channel, const PixelLine& points, uint8_t intensity);

  // Draws a disc. Coverage is max(0, min(1, radius + 0.5 - d)), where d is the distance in pixels
  // from the pixel's centre to `centre`. `radius` is in pixels.
  static void FillDisc(Raster* raster, int channel, const PixelPoint& centre, double radius,
                       uint8_t intensity);

  // Draws a rectangle. Coverage is the rectangle's share of a unit square that is centred on the
  // pixel and turned with the rectangle. If its sides are parallel to the picture's, that is its
  // share of the pixel. At any angle, the coverage of all pixels adds up to the rectangle's area.
  //   direction: unit vector along the length.
  //   half_length, half_width: pixels.
  static void FillBox(Raster* raster, int channel, const PixelPoint& centre,
                      const PixelPoint& direction, double half_length, double half_width,
                      uint8_t intensity);

  // Fills a simple polygon, convex or not; the last point joins the first. Coverage is the exact
  // share of the pixel's area. Draws nothing for fewer than three points.
  void FillPolygon(Raster* raster, int channel, std::span<const PixelPoint> points,
                   uint8_t intensity);

 private:
  void AddEdge(PixelPoint a, PixelPoint b, int rows, int columns);
  void AddEdgeInside(float u0, float v0, float u1, float v1, int stride);

  // Of the line at hand.
  std::vector<int64_t> sides_;
  std::vector<kernels::Chord> chords_;
  std::vector<kernels::PlacedSegment> segments_;
  // Signed area that each pixel gains over its left neighbour; all zero between calls.
  std::vector<float> area_gain_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_BRUSH_H_
