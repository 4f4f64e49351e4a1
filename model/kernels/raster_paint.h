// Paints antialiased shapes into a channel of a raster.
//
// A pixel becomes the maximum of its value and coverage * intensity, rounded. No product is fused
// with a sum, so all instruction sets paint the same bytes.

#ifndef MANEUVER_MODEL_KERNELS_RASTER_PAINT_H_
#define MANEUVER_MODEL_KERNELS_RASTER_PAINT_H_

#include <cstddef>
#include <cstdint>
#include <span>

namespace maneuver::kernels {

// Pixels are painted eight at a time. Rows have room for this many pixels after the last pixel of a
// shape.
inline constexpr int kPaintLanes = 8;

// Rows first_row .. last_row-1 of a channel.
struct PaintRows {
  int first_row;
  int last_row;
  uint8_t* pixels;   // of the first of those rows
  ptrdiff_t stride;  // from a row to its next
};

// A rectangle with the length 2 half_length along `direction`, as Brush::FillBox draws it.
struct BoxShape {
  double centre_u, centre_v;        // pixels
  double direction_u, direction_v;  // a unit vector
  double half_length, half_width;   // pixels
  float intensity;                  // 0 .. 255
};
// Paints columns first_column .. last_column-1, and up to kPaintLanes - 1 columns after them.
void PaintBox(const BoxShape& box, int first_column, int last_column, const PaintRows& rows);

// A segment of a line with soft edges: coverage is max(0, 1 - distance).
struct SegmentShape {
  float u, v;              // its start, pixels
  float along_u, along_v;  // from there to its end
  float intensity;         // 0 .. 255
};
struct PlacedSegment {
  SegmentShape shape;
  PaintRows rows;
};
// Paints the parts of segments in columns 0 .. width-1, and up to kPaintLanes columns after them.
void PaintSegments(std::span<const PlacedSegment> segments, int width);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_RASTER_PAINT_H_
