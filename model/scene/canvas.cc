#include "model/scene/canvas.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

#include "model/scene/sleeve.h"

namespace maneuver::scene {
namespace {

// Lines reach this far from their middle, pixels.
constexpr double kLineReach = 1.0;

// Calls body(0), ..., body(count - 1) and up to kLanes - 1 more: whole vectors, also for the short
// rows that most shapes have.
constexpr int kLanes = 8;
template <typename Body>
inline void ForEachLane(int count, const Body& body) {
  for (int first = 0; first < count; first += kLanes) {
    for (int lane = 0; lane < kLanes; ++lane) body(first + lane);
  }
}

// Narrows [*enter, *leave], parameters of a + t (b - a), to where the coordinate lies within
// [low, high].
void ClipParameter(double a, double b, double low, double high, double* enter, double* leave) {
  const double change = b - a;
  if (change == 0.0) {
    if (a < low || a > high) *leave = -1.0;
    return;
  }
  double first = (low - a) / change;
  double last = (high - a) / change;
  if (first > last) std::swap(first, last);
  *enter = std::max(*enter, first);
  *leave = std::min(*leave, last);
}

PixelPoint Between(const PixelPoint& a, const PixelPoint& b, double t) {
  return {a.u + t * (b.u - a.u), a.v + t * (b.v - a.v)};
}

// Within [0, limit]; 0 for what is not a number, so that no input leads outside the picture.
double Limited(double value, int limit) {
  return std::min(std::max(0.0, value), static_cast<double>(limit));
}

// First and one past the last pixel of `size` whose extent meets [low, high].
struct PixelRange {
  PixelRange(double low, double high, int size)
      : first(static_cast<int>(std::floor(Limited(low, size)))),
        last(static_cast<int>(std::ceil(Limited(high, size)))) {}
  int first;
  int last;
};

}  // namespace

Canvas::Canvas(int height, int width, int channels)
    : height_(height),
      width_(width),
      channels_(channels),
      area_gain_(static_cast<size_t>(height) * (static_cast<size_t>(width) + 2)),
      row_values_(width + kLanes) {
  assert(height > 0 && width > 0 && channels > 0);
}

void Canvas::Begin(std::span<uint8_t> picture) {
  assert(picture.size() == static_cast<size_t>(height_) * width_ * channels_);
  picture_ = picture;
  std::memset(picture_.data(), 0, picture_.size());
}

inline void Canvas::Paint(int channel, int row, int column, float value) {
  const auto rounded = static_cast<uint8_t>(value + 0.5F);
  uint8_t& pixel =
      picture_[(static_cast<size_t>(row) * width_ + column) * static_cast<size_t>(channels_) +
               channel];
  if (rounded > pixel) pixel = rounded;
}

inline void Canvas::PaintRow(int channel, int row, int column, int count) {
  if (count <= 0) return;
  uint8_t* pixel =
      &picture_[(static_cast<size_t>(row) * width_ + column) * static_cast<size_t>(channels_) +
                channel];
  for (int i = 0; i < count; ++i, pixel += channels_) {
    *pixel = static_cast<uint8_t>(std::max<int>(*pixel, row_values_[i]));
  }
}

void Canvas::DrawPolyline(int channel, std::span<const PixelPoint> points, uint8_t intensity) {
  if (points.size() < 2) return;
  const double low = -kLineReach;
  const double right = width_ + kLineReach;
  const double bottom = height_ + kLineReach;
  size_t start = 0;
  Sleeve sleeve(points[0]);
  for (size_t i = 1; i < points.size(); ++i) {
    const PixelPoint& a = points[i - 1];
    const PixelPoint& b = points[i];
    const bool outside = (a.u < low && b.u < low) || (a.u > right && b.u > right) ||
                         (a.v < low && b.v < low) || (a.v > bottom && b.v > bottom);
    if (!outside && sleeve.Extend(b)) continue;
    if (start < i - 1) DrawSegment(channel, points[start], a, intensity);
    start = outside ? i : i - 1;
    sleeve = Sleeve(points[start]);
    if (!outside) sleeve.Extend(b);
  }
  if (start < points.size() - 1) DrawSegment(channel, points[start], points.back(), intensity);
}

void Canvas::DrawSegment(int channel, PixelPoint a, PixelPoint b, float intensity) {
  // What is cut off lies too far outside to be seen, and floats suffice for the rest.
  constexpr double kMargin = 2 * kLineReach;
  double enter = 0.0;
  double leave = 1.0;
  ClipParameter(a.u, b.u, -kMargin, width_ + kMargin, &enter, &leave);
  ClipParameter(a.v, b.v, -kMargin, height_ + kMargin, &enter, &leave);
  if (!(enter <= leave)) return;
  const PixelPoint first = Between(a, b, enter);
  const PixelPoint last = Between(a, b, leave);

  const auto reach = static_cast<float>(kLineReach);
  const auto u = static_cast<float>(first.u);
  const auto v = static_cast<float>(first.v);
  const auto along_u = static_cast<float>(last.u - first.u);
  const auto along_v = static_cast<float>(last.v - first.v);
  const float length = std::sqrt(along_u * along_u + along_v * along_v);
  const float direction_u = length > 0.0F ? along_u / length : 1.0F;
  const float direction_v = length > 0.0F ? along_v / length : 0.0F;

  const auto [top, end_row] =
      PixelRange(std::min(first.v, last.v) - reach, std::max(first.v, last.v) + reach, height_);
  for (int row = top; row < end_row; ++row) {
    // The part of the segment that may lie within reach of this row's centres.
    const float centre = static_cast<float>(row) + 0.5F - v;
    float t0 = 0.0F;
    float t1 = 1.0F;
    if (along_v != 0.0F) {
      const float ta = (centre - reach) / along_v;
      const float tb = (centre + reach) / along_v;
      t0 = std::clamp(std::min(ta, tb), 0.0F, 1.0F);
      t1 = std::clamp(std::max(ta, tb), 0.0F, 1.0F);
    }
    const float u0 = u + t0 * along_u;
    const float u1 = u + t1 * along_u;
    const auto [left, end_column] =
        PixelRange(std::min(u0, u1) - reach, std::max(u0, u1) + reach, width_);
    const int count = end_column - left;
    const float first_u = static_cast<float>(left) + 0.5F - u;
    ForEachLane(count, [&](int i) {
      const float du = first_u + static_cast<float>(i);
      const float along = std::max(0.0F, std::min(du * direction_u + centre * direction_v, length));
      const float off_u = du - along * direction_u;
      const float off_v = centre - along * direction_v;
      const float distance = std::sqrt(off_u * off_u + off_v * off_v);
      row_values_[i] = static_cast<int>(std::max(0.0F, reach - distance) * intensity + 0.5F);
    });
    PaintRow(channel, row, left, count);
  }
}

void Canvas::FillDisc(int channel, const PixelPoint& centre, double radius, uint8_t intensity) {
  const double reach = radius + 0.5;
  const PixelRange rows(centre.v - reach, centre.v + reach, height_);
  const PixelRange columns(centre.u - reach, centre.u + reach, width_);
  for (int row = rows.first; row < rows.last; ++row) {
    for (int column = columns.first; column < columns.last; ++column) {
      const double distance = std::hypot(column + 0.5 - centre.u, row + 0.5 - centre.v);
      const double coverage = std::clamp(reach - distance, 0.0, 1.0);
      Paint(channel, row, column, static_cast<float>(coverage * intensity));
    }
  }
}

void Canvas::FillBox(int channel, const PixelPoint& centre, const PixelPoint& direction,
                     double half_length, double half_width, uint8_t intensity) {
  const double reach_u =
      (half_length + 0.5) * std::abs(direction.u) + (half_width + 0.5) * std::abs(direction.v);
  const double reach_v =
      (half_length + 0.5) * std::abs(direction.v) + (half_width + 0.5) * std::abs(direction.u);
  const PixelRange rows(centre.v - reach_v, centre.v + reach_v, height_);
  const PixelRange columns(centre.u - reach_u, centre.u + reach_u, width_);
  const auto cosine = static_cast<float>(direction.u);
  const auto sine = static_cast<float>(direction.v);
  // Along each axis of the box: where its overlap with a unit interval ends, and how much it can
  // be.
  const auto end_x = static_cast<float>(half_length + 0.5);
  const auto end_y = static_cast<float>(half_width + 0.5);
  const float most_x = std::min(1.0F, static_cast<float>(2.0 * half_length));
  const float most_y = std::min(1.0F, static_cast<float>(2.0 * half_width));
  const auto full = static_cast<float>(intensity);
  const int count = columns.last - columns.first;
  const auto first_u = static_cast<float>(columns.first + 0.5 - centre.u);
  for (int row = rows.first; row < rows.last; ++row) {
    const auto dv = static_cast<float>(row + 0.5 - centre.v);
    ForEachLane(count, [&](int i) {
      const float du = first_u + static_cast<float>(i);
      const float x = std::abs(cosine * du + sine * dv);
      const float y = std::abs(cosine * dv - sine * du);
      const float overlap_x = std::max(0.0F, std::min(most_x, end_x - x));
      const float overlap_y = std::max(0.0F, std::min(most_y, end_y - y));
      row_values_[i] = static_cast<int>(overlap_x * overlap_y * full + 0.5F);
    });
    PaintRow(channel, row, columns.first, count);
  }
}

// The signed area between each edge and everything to its right, summed over the edges, is the
// polygon's: an edge that spans dv rows' height within a pixel adds dv times the share of the pixel
// right of it there, and dv to all pixels further right. Those sums are kept as gains from pixel to
// pixel, so that one pass along each row yields the coverage.
void Canvas::FillPolygon(int channel, std::span<const PixelPoint> points, uint8_t intensity) {
  if (points.size() < 3) return;
  PixelPoint low = points[0];
  PixelPoint high = points[0];
  for (const PixelPoint& point : points) {
    low = {std::min(low.u, point.u), std::min(low.v, point.v)};
    high = {std::max(high.u, point.u), std::max(high.v, point.v)};
  }
  const PixelRange row_range(low.v, high.v, height_);
  const PixelRange column_range(low.u, high.u, width_);
  const int rows = row_range.last - row_range.first;
  const int columns = column_range.last - column_range.first;
  if (rows <= 0 || columns <= 0) return;

  const auto local = [&](const PixelPoint& point) {
    return PixelPoint{point.u - column_range.first, point.v - row_range.first};
  };
  PixelPoint previous = local(points.back());
  for (const PixelPoint& point : points) {
    const PixelPoint next = local(point);
    AddEdge(previous, next, rows, columns);
    previous = next;
  }

  const auto full = static_cast<float>(intensity);
  float* gain = area_gain_.data();
  for (int row = 0; row < rows; ++row, gain += columns + 2) {
    float area = 0.0F;
    for (int column = 0; column < columns; ++column) {
      area += gain[column];
      const float value = std::min(std::abs(area), 1.0F) * full;
      if (value >= 0.5F) {
        Paint(channel, row_range.first + row, column_range.first + column, value);
      }
    }
    std::fill(gain, gain + columns + 2, 0.0F);
  }
}

// Cuts an edge down to [0, columns] x [0, rows]. What lies left of that still covers all columns;
// what lies right of it, none.
void Canvas::AddEdge(PixelPoint a, PixelPoint b, int rows, int columns) {
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

void Canvas::AddEdgeInside(float u0, float v0, float u1, float v1, int stride) {
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
