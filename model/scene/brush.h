// Antialiased painting into the channels of a raster, eight neighbouring pixels at a time.
//
// Paint covers: a pixel takes max(what it is, coverage * intensity), so neither the order of
// painting nor painting twice matters. Coverage depends on where a shape lies relative to the
// pixel's centre and on nothing else, and fixed-point coordinates are nowhere used: a shape that is
// moved by whole pixels or mirrored gives the same bytes moved or mirrored.

#ifndef MANEUVER_MODEL_SCENE_BRUSH_H_
#define MANEUVER_MODEL_SCENE_BRUSH_H_

#include <cstdint>
#include <span>
#include <vector>

#include "model/scene/pixel_line.h"
#include "model/scene/raster.h"

namespace maneuver::scene {

// Holds scratch memory: one for each thread. Points may lie anywhere, at any distance outside the
// picture.
class Brush {
 public:
  // A line of one pixel's width with soft edges: coverage is max(0, 1 - d), d being the distance in
  // pixels from the pixel's centre to the polyline. Points within 0.03 pixels of the chord that
  // leaves them out are left out. Nothing for fewer than two points.
  void DrawPolyline(Raster* raster, int channel, const PixelLine& points, uint8_t intensity);

  // A disc: coverage is max(0, min(1, radius + 0.5 - d)), d being the distance in pixels from the
  // pixel's centre to `centre`.
  static void FillDisc(Raster* raster, int channel, const PixelPoint& centre, double radius,
                       uint8_t intensity);

  // A rectangle: coverage is the share of a unit square around the pixel's centre, turned with the
  // rectangle, that lies within it. Where the sides lie along the picture's that is the share of
  // the pixel; at any angle the coverage of all pixels adds up to the rectangle's area.
  //   direction: of the length, a unit vector.
  static void FillBox(Raster* raster, int channel, const PixelPoint& centre,
                      const PixelPoint& direction, double half_length, double half_width,
                      uint8_t intensity);

  // The inside of a simple polygon (convex or not; the last point joins the first): coverage is the
  // exact share of the pixel's area. Nothing for fewer than three points.
  void FillPolygon(Raster* raster, int channel, std::span<const PixelPoint> points,
                   uint8_t intensity);

 private:
  void AddEdge(PixelPoint a, PixelPoint b, int rows, int columns);
  void AddEdgeInside(float u0, float v0, float u1, float v1, int stride);

  std::vector<int64_t> sides_;  // of a polyline's points
  // Signed area that each pixel gains over its left neighbour; all zero between calls.
  std::vector<float> area_gain_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_BRUSH_H_
