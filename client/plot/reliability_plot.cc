#include "client/plot/reliability_plot.h"

#include <algorithm>
#include <exception>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"

namespace maneuver::plot {
namespace {

constexpr Color kFrame = {120, 120, 120};
constexpr Color kDiagonal = {150, 150, 150};
constexpr Color kCurve = {0, 114, 178};
constexpr Color kGap = {213, 94, 0};
constexpr Color kBars = {170, 196, 216};
constexpr int kPlotWidth = 720;
constexpr int kPlotHeight = 950;
constexpr Box kCurveBox = {96.0, 92.0, 590.0, 590.0};
constexpr Box kCountBox = {96.0, 706.0, 590.0, 170.0};
constexpr double kPlotLetters = 9.0;

void DrawCurve(const v1::EvaluationReport& report, Canvas* canvas) {
  const Axes axes(kCurveBox, {0.0, 1.0, 0.0, 1.0});
  const AxesStyle style{kFrame, kFaintInk, {238, 238, 238}, kPlotLetters, 110.0, false};
  axes.DrawGrid(style, canvas);
  canvas->Dashes({axes.ToPixel(0.0, 0.0), axes.ToPixel(1.0, 1.0)}, kDiagonal, 1.6, 7.0, 6.0);
  Line curve;
  std::vector<Line> gaps;
  for (const v1::ReliabilityBin& bin : report.reliability()) {
    if (bin.examples() == 0) continue;
    curve.push_back(axes.ToPixel(bin.mean_confidence(), bin.mean_responsibility()));
    gaps.push_back({curve.back(), axes.ToPixel(bin.mean_confidence(), bin.mean_confidence())});
  }
  canvas->Strokes(gaps, kGap, 3.0);
  canvas->Stroke(curve, kCurve, 2.4);
  for (const Pixel& point : curve) {
    canvas->Disc(point, 6.4, kPaper);
    canvas->Disc(point, 5.0, kCurve);
  }
  axes.DrawFrame(style, canvas);
  // Labels stand in the corner that a calibrated curve leaves free.
  const double left = kCurveBox.left + 24.0;
  double y = kCurveBox.top + 34.0;
  const auto key = [&](Color color, const std::string& text, bool dashed) {
    const Line swatch = {{left, y}, {left + 26.0, y}};
    if (dashed) {
      canvas->Dashes(swatch, color, 1.6, 7.0, 6.0);
    } else {
      canvas->Stroke(swatch, color, 3.0);
    }
    canvas->Text(text, {left + 36.0, y + kPlotLetters / 2.0}, kPlotLetters, kInk);
    y += 22.0;
  };
  key(kCurve, "measured", false);
  key(kGap, "off by", false);
  key(kDiagonal, "perfectly calibrated", true);
  canvas->TextUpwards("mean q(y|x,s) of that action",
                      {kCurveBox.left - 58.0, kCurveBox.top + kCurveBox.height / 2.0},
                      kPlotLetters + 1.0, kFaintInk);
}

void DrawCounts(const v1::EvaluationReport& report, Canvas* canvas) {
  int64_t most = 1;
  for (const v1::ReliabilityBin& bin : report.reliability()) most = std::max(most, bin.examples());
  const auto across = [](double p) { return kCountBox.left + p * kCountBox.width; };
  constexpr double kRoom = 24.0;  // for the number over the highest bar
  for (const v1::ReliabilityBin& bin : report.reliability()) {
    const double high = (kCountBox.height - kRoom) * static_cast<double>(bin.examples()) /
                        static_cast<double>(most);
    const double left = across(bin.lower()) + 2.0;
    const double right = across(bin.upper()) - 2.0;
    canvas->Rectangle({left, kCountBox.bottom() - high, right - left, high}, kBars);
    canvas->Text(absl::StrCat(bin.examples()),
                 {(left + right) / 2.0, kCountBox.bottom() - high - 6.0}, kPlotLetters, kFaintInk,
                 Anchor::kCenter);
  }
  canvas->Strokes({{{kCountBox.left, kCountBox.top},
                    {kCountBox.left, kCountBox.bottom()},
                    {kCountBox.right(), kCountBox.bottom()},
                    {kCountBox.right(), kCountBox.top}}},
                  kFrame, 1.0);
  for (int i = 0; i <= 5; ++i) {
    const double p = 0.2 * i;
    canvas->Stroke({{across(p), kCountBox.bottom()}, {across(p), kCountBox.bottom() + 4.0}}, kFrame,
                   1.0);
    canvas->Text(absl::StrFormat("%.1f", p), {across(p), kCountBox.bottom() + 8.0 + kPlotLetters},
                 kPlotLetters, kFaintInk, Anchor::kCenter);
  }
  canvas->Text("p(y|s) of the most probable action",
               {kCountBox.left + kCountBox.width / 2.0, kCountBox.bottom() + 46.0},
               kPlotLetters + 1.0, kFaintInk, Anchor::kCenter);
  canvas->TextUpwards("examples", {kCountBox.left - 58.0, kCountBox.top + kCountBox.height / 2.0},
                      kPlotLetters + 1.0, kFaintInk);
}

std::string PaintReliability(const v1::EvaluationReport& report) {
  Canvas canvas(kPlotWidth, kPlotHeight, kPaper);
  const auto error = report.metrics().find("calibration_error");
  const std::string title = error == report.metrics().end()
                                ? "Reliability of p(y|s)"
                                : absl::StrFormat("Reliability of p(y|s): ECE %.3f", error->second);
  canvas.Text(title, {kCurveBox.left, 38.0}, 14.0, kInk, Anchor::kLeft, true);
  canvas.Text(absl::StrFormat("%s on %s, %d examples", report.model_version(), report.dataset(),
                              report.examples()),
              {kCurveBox.left, 66.0}, 10.0, kFaintInk);
  DrawCurve(report, &canvas);
  DrawCounts(report, &canvas);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawReliability(const v1::EvaluationReport& report) {
  const bool any = std::any_of(report.reliability().begin(), report.reliability().end(),
                               [](const v1::ReliabilityBin& bin) { return bin.examples() > 0; });
  if (!any) {
    return absl::InvalidArgumentError("nothing to draw: the report has no reliability table");
  }
  try {
    return PaintReliability(report);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the reliability: ", error.what()));
  }
}

}  // namespace maneuver::plot
