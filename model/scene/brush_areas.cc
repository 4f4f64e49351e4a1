#include <algorithm>
#include <cmath>

#include "model/kernels/raster_paint.h"
#include "model/scene/brush.h"
#include "model/scene/clipping.h"

namespace maneuver::scene {
namespace {

void Paint(float value, uint8_t* pixel) {
  *pixel = std::max(*pixel, static_cast<uint8_t>(value + 0.5F));
}

}  // namespace

void Brush::FillDisc(Raster* raster, int channel, const PixelPoint& centre, double radius,
                     uint8_t intensity) {
  const double reach = radius + 0.5;
  const PixelRange rows(centre.v - reach, centre.v + reach, raster->height());
  const PixelRange columns(centre.u - reach, centre.u + reach, raster->width());
  if (rows.first >= rows.last || columns.first >= columns.last) return;
  const PixelBlocks blocks = raster->BlocksOf(columns.first, columns.last - 1);
  uint8_t* pixels = raster->Row(channel, rows.first);
  for (int row = rows.first; row < rows.last; ++row, pixels += raster->stride()) {
    raster->MarkNonzero(channel, row, blocks);
    for (int column = columns.first; column < columns.last; ++column) {
      const double distance = std::hypot(column + 0.5 - centre.u, row + 0.5 - centre.v);
      const double coverage = std::clamp(reach - distance, 0.0, 1.0);
      Paint(static_cast<float>(coverage * intensity), &pixels[column]);
    }
  }
}

void Brush::FillBox(Raster* raster, int channel, const PixelPoint& centre,
                    const PixelPoint& direction, double half_length, double half_width,
                    uint8_t intensity) {
  const double reach_u =
      (half_length + 0.5) * std::abs(direction.u) + (half_width + 0.5) * std::abs(direction.v);
  const double reach_v =
      (half_length + 0.5) * std::abs(direction.v) + (half_width + 0.5) * std::abs(direction.u);
  const PixelRange rows(centre.v - reach_v, centre.v + reach_v, raster->height());
  const PixelRange columns(centre.u - reach_u, centre.u + reach_u, raster->width());
  if (rows.first >= rows.last || columns.first >= columns.last) return;
  constexpr int kLanes = kernels::kPaintLanes;
  const int last =
      columns.first + (columns.last - columns.first + kLanes - 1) / kLanes * kLanes - 1;
  const PixelBlocks blocks = raster->BlocksOf(columns.first, last);
  for (int row = rows.first; row < rows.last; ++row) raster->MarkNonzero(channel, row, blocks);
  kernels::PaintBox({.centre_u = centre.u,
                     .centre_v = centre.v,
                     .direction_u = direction.u,
                     .direction_v = direction.v,
                     .half_length = half_length,
                     .half_width = half_width,
                     .intensity = static_cast<float>(intensity)},
                    columns.first, columns.last,
                    {.first_row = rows.first,
                     .last_row = rows.last,
                     .pixels = raster->Row(channel, rows.first),
                     .stride = raster->stride()});
}

// The signed area between each edge and everything to its right, summed over the edges, is the
// polygon's: an edge that spans dv rows' height within a pixel adds dv times the share of the pixel
// right of it there, and dv to all pixels further right. Those sums are kept as gains from pixel to
// pixel, so that one pass along each row yields the coverage.
void Brush::FillPolygon(Raster* raster, int channel, std::span<const PixelPoint> points,
                        uint8_t intensity) {
  if (points.size() < 3) return;
  PixelPoint low = points[0];
  PixelPoint high = points[0];
  for (const PixelPoint& point : points) {
    low = {std::min(low.u, point.u), std::min(low.v, point.v)};
    high = {std::max(high.u, point.u), std::max(high.v, point.v)};
  }
  const PixelRange row_range(low.v, high.v, raster->height());
  const PixelRange column_range(low.u, high.u, raster->width());
  const int rows = row_range.last - row_range.first;
  const int columns = column_range.last - column_range.first;
  if (rows <= 0 || columns <= 0) return;

  const auto local = [&](const PixelPoint& point) {
    return PixelPoint{point.u - column_range.first, point.v - row_range.first};
  };
  // Two more in each row: an edge at the right border changes what lies beyond it.
  area_gain_.resize(std::max(area_gain_.size(), static_cast<size_t>(rows) * (columns + 2)));
  PixelPoint previous = local(points.back());
  for (const PixelPoint& point : points) {
    const PixelPoint next = local(point);
    AddEdge(previous, next, rows, columns);
    previous = next;
  }

  const auto full = static_cast<float>(intensity);
  float* gain = area_gain_.data();
  const PixelBlocks blocks = raster->BlocksOf(column_range.first, column_range.last - 1);
  uint8_t* pixels = raster->Row(channel, row_range.first) + column_range.first;
  for (int row = 0; row < rows; ++row, gain += columns + 2, pixels += raster->stride()) {
    raster->MarkNonzero(channel, row_range.first + row, blocks);
    float area = 0.0F;
    for (int column = 0; column < columns; ++column) {
      area += gain[column];
      Paint(std::min(std::abs(area), 1.0F) * full, &pixels[column]);
    }
    std::fill(gain, gain + columns + 2, 0.0F);
  }
}

// Cuts an edge down to [0, columns] x [0, rows]. What lies left of that still covers all columns;
// what lies right of it, none.
void Brush::AddEdge(PixelPoint a, PixelPoint b, int rows, int columns) {
  double enter = 0.0;
  double leave = 1.0;
  ClipParameter(a.v, b.v, 0.0, rows, &enter, &leave);
  if (a.v == b.v || !(enter < leave)) return;
  const double du = b.u - a.u;
  double cuts[4] = {enter, leave, leave, leave};
  int pieces = 1;
  if (du != 0.0) {
    const double at_left = -a.u / du;
    const double at_right = (columns - a.u) / du;
    for (const double cut : {std::min(at_left, at_right), std::max(at_left, at_right)}) {
      if (cut > enter && cut < leave) {
        cuts[pieces] = cut;
        cuts[++pieces] = leave;
      }
    }
  }
  for (int piece = 0; piece < pieces; ++piece) {
    PixelPoint p = Between(a, b, cuts[piece]);
    PixelPoint q = Between(a, b, cuts[piece + 1]);
    if (p.u + q.u >= 2.0 * columns) continue;
    p = {Limited(p.u, columns), Limited(p.v, rows)};
    q = {Limited(q.u, columns), Limited(q.v, rows)};
    AddEdgeInside(static_cast<float>(p.u), static_cast<float>(p.v), static_cast<float>(q.u),
                  static_cast<float>(q.v), columns + 2);
  }
}

void Brush::AddEdgeInside(float u0, float v0, float u1, float v1, int stride) {
  if (v0 == v1) return;
  const float sign = v0 < v1 ? 1.0F : -1.0F;
  if (v0 > v1) {
    std::swap(u0, u1);
    std::swap(v0, v1);
  }
  const float slope = (u1 - u0) / (v1 - v0);
  const float low = std::min(u0, u1);
  const float high = std::max(u0, u1);
  float from = u0;  // where the edge enters the row
  for (auto row = static_cast<int>(v0); static_cast<float>(row) < v1; ++row) {
    const float top = std::max(v0, static_cast<float>(row));
    const float bottom = std::min(v1, static_cast<float>(row + 1));
    const float to = std::clamp(u0 + (bottom - v0) * slope, low, high);
    const float left = std::min(from, to);
    const float right = std::max(from, to);
    const float drop = sign * (bottom - top);
    float* gain = &area_gain_[static_cast<size_t>(row) * stride];
    auto column = static_cast<int>(left);
    if (right <= static_cast<float>(column + 1)) {  // within one pixel
      const float uncovered = 0.5F * (left + right) - static_cast<float>(column);
      gain[column] += drop * (1.0F - uncovered);
      gain[column + 1] += drop * uncovered;
    } else {
      // Within each pixel that it crosses, the edge drops by its share and covers what lies right
      // of it in that pixel.
      const float drop_per_pixel = drop / (right - left);
      for (float u = left; u < right; ++column) {
        const float next = std::min(right, static_cast<float>(column + 1));
        const float share = drop_per_pixel * (next - u);
        const float uncovered = 0.5F * (u + next) - static_cast<float>(column);
        gain[column] += share * (1.0F - uncovered);
        gain[column + 1] += share * uncovered;
        u = next;
      }
    }
    from = to;
  }
}

}  // namespace maneuver::scene
