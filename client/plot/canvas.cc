#include "client/plot/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "client/plot/png.h"

namespace maneuver::plot {
namespace {

constexpr int kScale = 2;     // supersampling
constexpr int kShift = 4;     // fractional bits of OpenCV's coordinates
constexpr double kFar = 1e6;  // pixels; points further away are drawn here
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kCapHeight = 21.0;  // of that font at scale 1, pixels

cv::Scalar Bgr(Color color) { return {double(color.blue), double(color.green), double(color.red)}; }

double FontScale(double height) { return height * kScale / kCapHeight; }

int FontThickness(double height, bool bold) {
  return std::max(1, static_cast<int>(std::lround(height * kScale * (bold ? 0.16 : 0.10))));
}

std::string Ascii(const std::string& text) {
  std::string ascii;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0) == 0x80) continue;  // rest of a character already drawn as '?'
    ascii += byte >= 0x20 && byte < 0x7F ? c : '?';
  }
  return ascii;
}

// Converts to coordinates within `clip`, in OpenCV's fixed point.
std::vector<cv::Point> Fixed(const Line& line, const cv::Rect& clip) {
  std::vector<cv::Point> points;
  points.reserve(line.size());
  for (const Pixel& p : line) {
    const double x = std::clamp(p.x * kScale - clip.x, -kFar, kFar);
    const double y = std::clamp(p.y * kScale - clip.y, -kFar, kFar);
    // The centre of pixel (0, 0) is 0 in OpenCV and 0.5 here.
    points.emplace_back(static_cast<int>(std::lround((x - 0.5) * (1 << kShift))),
                        static_cast<int>(std::lround((y - 0.5) * (1 << kShift))));
  }
  return points;
}

// Returns the area that the lines cover, grown by `margin`, in the clip's coordinates.
cv::Rect Area(const std::vector<Line>& lines, double margin, const cv::Rect& clip) {
  double left = kFar;
  double right = -kFar;
  double top = kFar;
  double bottom = -kFar;
  for (const Line& line : lines) {
    for (const Pixel& p : line) {
      left = std::min(left, p.x);
      right = std::max(right, p.x);
      top = std::min(top, p.y);
      bottom = std::max(bottom, p.y);
    }
  }
  if (left > right) return {};
  const auto low = [&](double value, int offset) {
    return static_cast<int>(
        std::floor(std::clamp((value - margin) * kScale - offset, -kFar, kFar)));
  };
  const auto high = [&](double value, int offset) {
    return static_cast<int>(std::ceil(std::clamp((value + margin) * kScale - offset, -kFar, kFar)));
  };
  const cv::Point first(low(left, clip.x), low(top, clip.y));
  const cv::Point last(high(right, clip.x) + 1, high(bottom, clip.y) + 1);
  return cv::Rect(first, last) & cv::Rect(0, 0, clip.width, clip.height);
}

Color FromHsv(double hue, double saturation, double value) {
  const auto channel = [&](double n) {
    const double k = std::fmod(n + hue * 6.0, 6.0);
    const double level = value - value * saturation * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0);
    return static_cast<int>(std::lround(255.0 * level));
  };
  return {channel(5), channel(3), channel(1)};
}

}  // namespace

Color ActionColor(int action_id) {
  // Eight hues, then the same hues in other strengths. None is the red of other agents or the
  // yellow of the target. The order keeps neighbouring ids apart.
  constexpr std::array<double, 8> kHues = {0.58, 0.08, 0.36, 0.84, 0.49, 0.24, 0.72, 0.93};
  constexpr std::array<std::pair<double, double>, 4> kStrengths = {
      std::pair{0.72, 1.0}, {0.42, 1.0}, {0.80, 0.82}, {0.50, 0.66}};  // saturation, value
  const auto id = static_cast<size_t>(std::max(action_id, 0));
  const auto [saturation, value] = kStrengths[id / kHues.size() % kStrengths.size()];
  return FromHsv(kHues[id % kHues.size()], saturation, value);
}

Color LatentColor(int dimension) {
  // The eight colours of Okabe and Ito for colour-blind people, with grey instead of black and a
  // darker yellow.
  constexpr std::array<Color, kLatentColors> kColors = {
      Color{0, 114, 178}, {230, 159, 0},  {0, 158, 115}, {213, 94, 0},
      {204, 121, 167},    {86, 180, 233}, {196, 181, 0}, {130, 130, 130}};
  return kColors[static_cast<size_t>(dimension) % kColors.size()];
}

Canvas::Canvas(int width, int height, Color background)
    : picture_(height * kScale, width * kScale, CV_8UC3, Bgr(background)),
      clip_(0, 0, width * kScale, height * kScale),
      layer_(cv::Mat::zeros(height * kScale, width * kScale, CV_8UC1)) {}

void Canvas::ClipTo(const Box& box) {
  clip_ = cv::Rect(static_cast<int>(std::lround(box.left * kScale)),
                   static_cast<int>(std::lround(box.top * kScale)),
                   static_cast<int>(std::lround(box.width * kScale)),
                   static_cast<int>(std::lround(box.height * kScale))) &
          cv::Rect(0, 0, picture_.cols, picture_.rows);
}

void Canvas::ClipToAll() { clip_ = cv::Rect(0, 0, picture_.cols, picture_.rows); }

void Canvas::Blend(const cv::Rect& area, Color color, double opacity) {
  if (area.empty()) return;
  cv::Mat target = picture_(clip_)(area);
  cv::Mat coverage = layer_(clip_)(area);
  const std::array<int, 3> bgr = {color.blue, color.green, color.red};
  const int weight = static_cast<int>(std::lround(std::clamp(opacity, 0.0, 1.0) * 256.0));
  for (int row = 0; row < area.height; ++row) {
    auto* pixel = target.ptr<uint8_t>(row);
    auto* covered = coverage.ptr<uint8_t>(row);
    for (int column = 0; column < area.width; ++column, pixel += 3) {
      if (covered[column] == 0) continue;
      const int alpha = covered[column] * weight / 256;
      for (int c = 0; c < 3; ++c) {
        pixel[c] = static_cast<uint8_t>(
            (pixel[c] * (255 - alpha) + bgr[static_cast<size_t>(c)] * alpha + 127) / 255);
      }
      covered[column] = 0;
    }
  }
}

void Canvas::Strokes(const std::vector<Line>& lines, Color color, double width, double opacity) {
  const cv::Rect area = Area(lines, width + 1.0, clip_);
  if (area.empty()) return;
  cv::Mat layer = layer_(clip_);
  const int thickness = std::max(1, static_cast<int>(std::lround(width * kScale)));
  for (const Line& line : lines) {
    cv::polylines(layer, Fixed(line, clip_), false, cv::Scalar(255), thickness, cv::LINE_AA,
                  kShift);
  }
  Blend(area, color, opacity);
}

void Canvas::Stroke(const Line& line, Color color, double width, double opacity) {
  Strokes({line}, color, width, opacity);
}

void Canvas::Dashes(const Line& line, Color color, double width, double dash, double gap) {
  std::vector<Line> dashes;
  double along = 0.0;  // since the last dash began
  for (size_t i = 0; i + 1 < line.size(); ++i) {
    const Pixel step = line[i + 1] - line[i];
    const double length = std::hypot(step.x, step.y);
    if (!(length > 0.0) || length > kFar) continue;
    for (double at = 0.0; at < length;) {
      const bool drawn = along < dash;
      const double until = std::min(length, at + (drawn ? dash : dash + gap) - along);
      if (drawn)
        dashes.push_back({line[i] + step * (at / length), line[i] + step * (until / length)});
      along += until - at;
      if (along >= dash + gap - 1e-9) along = 0.0;
      at = until;
    }
  }
  Strokes(dashes, color, width);
}

void Canvas::Polygons(const std::vector<Line>& polygons, Color color, double opacity) {
  const cv::Rect area = Area(polygons, 1.0, clip_);
  if (area.empty()) return;
  cv::Mat layer = layer_(clip_);
  for (const Line& polygon : polygons) {
    if (polygon.size() < 3) continue;
    cv::fillPoly(layer, std::vector<std::vector<cv::Point>>{Fixed(polygon, clip_)}, cv::Scalar(255),
                 cv::LINE_AA, kShift);
  }
  Blend(area, color, opacity);
}

void Canvas::Disc(const Pixel& center, double radius, Color color, double opacity) {
  Line circle;
  constexpr int kCorners = 32;
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 2.0 * M_PI * i / kCorners;
    circle.emplace_back(center.x + radius * std::cos(angle), center.y + radius * std::sin(angle));
  }
  Polygons({circle}, color, opacity);
}

void Canvas::Rectangle(const Box& box, Color color, double opacity) {
  Polygons({{{box.left, box.top},
             {box.right(), box.top},
             {box.right(), box.bottom()},
             {box.left, box.bottom()}}},
           color, opacity);
}

double Canvas::TextWidth(const std::string& text, double height, bool bold) {
  int below = 0;
  return cv::getTextSize(Ascii(text), kFont, FontScale(height), FontThickness(height, bold), &below)
             .width /
         double(kScale);
}

double Canvas::HeightToFit(const std::string& text, double height, double room) {
  return height * std::clamp(room / std::max(TextWidth(text, height), 1.0), 0.5, 1.0);
}

void Canvas::Text(const std::string& text, const Pixel& baseline, double height, Color color,
                  Anchor anchor, bool bold) {
  const double width = TextWidth(text, height, bold);
  const double left = baseline.x - (anchor == Anchor::kLeft     ? 0.0
                                    : anchor == Anchor::kCenter ? width / 2.0
                                                                : width);
  cv::putText(picture_, Ascii(text),
              cv::Point(static_cast<int>(std::lround(left * kScale)),
                        static_cast<int>(std::lround(baseline.y * kScale))),
              kFont, FontScale(height), Bgr(color), FontThickness(height, bold), cv::LINE_AA);
}

void Canvas::TextUpwards(const std::string& text, const Pixel& middle, double height, Color color) {
  const int width = static_cast<int>(std::ceil(TextWidth(text, height) + 2.0)) * kScale;
  const int full = static_cast<int>(std::ceil(2.0 * height)) * kScale;
  cv::Mat letters = cv::Mat::zeros(full, width, CV_8UC1);
  cv::putText(letters, Ascii(text), cv::Point(kScale, full * 3 / 4), kFont, FontScale(height),
              cv::Scalar(255), FontThickness(height, false), cv::LINE_AA);
  cv::rotate(letters, letters, cv::ROTATE_90_COUNTERCLOCKWISE);
  const cv::Rect place(static_cast<int>(middle.x * kScale) - letters.cols / 2,
                       static_cast<int>(middle.y * kScale) - letters.rows / 2, letters.cols,
                       letters.rows);
  const cv::Rect seen = place & cv::Rect(0, 0, picture_.cols, picture_.rows);
  if (seen.empty()) return;
  const cv::Rect before = clip_;
  ClipToAll();
  letters(seen - place.tl()).copyTo(layer_(seen));
  Blend(seen, color, 1.0);
  clip_ = before;
}

std::string Canvas::EncodePng() const {
  cv::Mat small;
  cv::resize(picture_, small, cv::Size(picture_.cols / kScale, picture_.rows / kScale), 0.0, 0.0,
             cv::INTER_AREA);
  return plot::EncodePng(small);
}

}  // namespace maneuver::plot
