#include "client/plot/axes.h"

#include <cmath>
#include <cstdio>

namespace maneuver::plot {
std::vector<double> Ticks(double low, double high, int count) {
  const double rough = (high - low) / std::max(count, 1);
  if (!(rough > 0.0)) return {low};
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * power;
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough) {
      step = factor * power;
      break;
    }
  }
  std::vector<double> ticks;
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i) {
    ticks.push_back(i * step + 0.0);  // avoids negative zero
  }
  return ticks;
}

std::string TickText(double tick, double step) {
  const int decimals =
      step >= 1.0 - 1e-9 ? 0 : static_cast<int>(std::ceil(-std::log10(step) - 1e-9));
  char text[32];
  std::snprintf(text, sizeof(text), "%.*f", decimals, tick);
  return text;
}

Axes::Axes(const Box& box, const Extent& extent)
    : box_(box),
      pixels_per_meter_(std::min(box.width / std::max(extent.max_x - extent.min_x, 1e-3),
                                 box.height / std::max(extent.max_y - extent.min_y, 1e-3))),
      left_((extent.min_x + extent.max_x) / 2.0 - box.width / pixels_per_meter_ / 2.0),
      lower_((extent.min_y + extent.max_y) / 2.0 - box.height / pixels_per_meter_ / 2.0) {}

Pixel Axes::ToPixel(double x, double y) const {
  return {box_.left + (x - left_) * pixels_per_meter_,
          box_.bottom() - (y - lower_) * pixels_per_meter_};
}

void Axes::DrawGrid(const AxesStyle& style, Canvas* canvas) const {
  std::vector<Line> lines;
  const int across = std::max(2, static_cast<int>(box_.width / style.tick_distance));
  const int up = std::max(2, static_cast<int>(box_.height / style.tick_distance));
  for (const double x : Ticks(left_, left_ + box_.width / pixels_per_meter_, across)) {
    const double at = ToPixel(x, 0.0).x;
    lines.push_back({{at, box_.top}, {at, box_.bottom()}});
  }
  for (const double y : Ticks(lower_, lower_ + box_.height / pixels_per_meter_, up)) {
    const double at = ToPixel(0.0, y).y;
    lines.push_back({{box_.left, at}, {box_.right(), at}});
  }
  canvas->Strokes(lines, style.grid, 1.0);
}

void Axes::DrawFrame(const AxesStyle& style, Canvas* canvas) const {
  std::vector<Line> lines = {{{box_.left, box_.top},
                              {box_.right(), box_.top},
                              {box_.right(), box_.bottom()},
                              {box_.left, box_.bottom()},
                              {box_.left, box_.top}}};
  constexpr double kTick = 4.0;
  const double height = style.text_height;
  const int across = std::max(2, static_cast<int>(box_.width / style.tick_distance));
  const int up = std::max(2, static_cast<int>(box_.height / style.tick_distance));
  const auto step = [](const std::vector<double>& ticks) {
    return ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0;
  };
  const std::vector<double> xs = Ticks(left_, left_ + box_.width / pixels_per_meter_, across);
  for (const double x : xs) {
    const double at = ToPixel(x, 0.0).x;
    lines.push_back({{at, box_.bottom()}, {at, box_.bottom() + kTick}});
    canvas->Text(TickText(x, step(xs)), {at, box_.bottom() + kTick + 4.0 + height}, height,
                 style.text, Anchor::kCenter);
  }
  const std::vector<double> ys = Ticks(lower_, lower_ + box_.height / pixels_per_meter_, up);
  for (const double y : ys) {
    const double at = ToPixel(0.0, y).y;
    lines.push_back({{box_.left - kTick, at}, {box_.left, at}});
    canvas->Text(TickText(y, step(ys)), {box_.left - kTick - 4.0, at + height / 2.0}, height,
                 style.text, Anchor::kRight);
  }
  canvas->Strokes(lines, style.frame, 1.0);
  if (style.titles) {
    canvas->Text("ahead [m]",
                 {box_.left + box_.width / 2.0, box_.bottom() + kTick + 4.0 + 2.9 * height}, height,
                 style.text, Anchor::kCenter);
    canvas->TextUpwards("left [m]", {box_.left - 4.6 * height, box_.top + box_.height / 2.0},
                        height, style.text);
  }
}

}  // namespace maneuver::plot
