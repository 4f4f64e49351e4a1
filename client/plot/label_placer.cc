#include "client/plot/label_placer.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace maneuver::plot {

void LabelPlacer::Occupy(const Box& box) { occupied_.push_back(box); }

void LabelPlacer::Occupy(const Line& line, double width) {
  for (size_t i = 0; i + 1 < line.size(); ++i) {
    const Pixel step = line[i + 1] - line[i];
    const int pieces = std::clamp(static_cast<int>(std::hypot(step.x, step.y) / width), 1, 1000);
    for (int piece = 0; piece <= pieces; ++piece) {
      const Pixel middle = line[i] + step * (static_cast<double>(piece) / pieces);
      Occupy({middle.x - width / 2.0, middle.y - width / 2.0, width, width});
    }
  }
}

bool LabelPlacer::Free(const Box& box) const {
  if (box.left < whole_.left || box.right() > whole_.right() || box.top < whole_.top ||
      box.bottom() > whole_.bottom()) {
    return false;
  }
  return std::none_of(occupied_.begin(), occupied_.end(), [&](const Box& other) {
    return box.left < other.right() && other.left < box.right() && box.top < other.bottom() &&
           other.top < box.bottom();
  });
}

std::optional<LabelPlacer::Placement> LabelPlacer::Place(const Pixel& point,
                                                         const std::string& text, double height,
                                                         double farthest) {
  constexpr double kPadding = 3.0;
  constexpr double kStep = 8.0;
  // Directions in eighths of a turn, from straight right.
  constexpr std::array<int, 8> kTurns = {0, 1, -1, 2, -2, 3, -3, 4};
  const double width = Canvas::TextWidth(text, height, true) + 2.0 * kPadding;
  const double full = height + 2.0 * kPadding;
  for (double gap = 7.0; gap <= farthest; gap += kStep) {
    for (const int turn : kTurns) {
      const double angle = turn * M_PI / 4.0;
      // The frame's middle, chosen so that the gap is between point and frame.
      const Pixel middle = {point.x + std::cos(angle) * (gap + width / 2.0),
                            point.y - std::sin(angle) * (gap + full / 2.0)};
      const Box frame{middle.x - width / 2.0, middle.y - full / 2.0, width, full};
      if (!Free(frame)) continue;
      Occupy(frame);
      return Placement{frame, {middle.x, middle.y + height / 2.0}, gap};
    }
  }
  return std::nullopt;
}

}  // namespace maneuver::plot
