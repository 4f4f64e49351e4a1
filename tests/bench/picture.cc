#include "tests/bench/picture.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace maneuver::bench {
namespace {

// Colours that colour-blind people can also distinguish (Okabe and Ito).
constexpr const char* kColors[] = {"#0072b2", "#e69f00", "#009e73", "#d55e00",
                                   "#56b4e9", "#cc79a7", "#999999", "#000000"};
constexpr const char* kGrid = "#e4e4e4";
constexpr const char* kInk = "#333333";

const char* Color(size_t i) { return kColors[i % std::size(kColors)]; }

std::string Escaped(const std::string& text) {
  return absl::StrReplaceAll(text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}});
}

class Svg {
 public:
  Svg(int width, int height)
      : text_(absl::StrFormat("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%d\" "
                              "height=\"%d\" font-family=\"sans-serif\" font-size=\"13\">\n"
                              "<rect width=\"100%%\" height=\"100%%\" fill=\"white\"/>\n",
                              width, height)) {}

  void Line(double x1, double y1, double x2, double y2, const char* color) {
    absl::StrAppendFormat(&text_,
                          "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"%s\" stroke-width=\"1\"/>\n",
                          x1, y1, x2, y2, color);
  }
  void Curve(const std::vector<double>& x, const std::vector<double>& y, const char* color) {
    absl::StrAppend(&text_, "<polyline fill=\"none\" stroke-width=\"2\" stroke=\"", color,
                    "\" points=\"");
    for (size_t i = 0; i < x.size(); ++i) absl::StrAppendFormat(&text_, "%.1f,%.1f ", x[i], y[i]);
    absl::StrAppend(&text_, "\"/>\n");
    for (size_t i = 0; i < x.size(); ++i) {
      absl::StrAppendFormat(&text_, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3\" fill=\"%s\"/>\n", x[i],
                            y[i], color);
    }
  }
  void Rectangle(double x, double y, double width, double height, const char* color) {
    absl::StrAppendFormat(
        &text_, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"/>\n", x, y,
        width, height, color);
  }
  //   anchor: "start", "middle" or "end".
  void Text(double x, double y, const char* anchor, const std::string& text, const char* color,
            const char* more = "") {
    absl::StrAppendFormat(
        &text_, "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" fill=\"%s\" %s>%s</text>\n", x, y,
        anchor, color, more, Escaped(text));
  }
  std::string Take() && { return std::move(text_) + "</svg>\n"; }

 private:
  std::string text_;
};

// Returns ticks from 0 to at least `most`, 1, 2 or 5 times a power of ten apart.
std::vector<double> TicksTo(double most) {
  const double rough = std::max(most, 1e-9) / 5.0;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  const double factor = rough <= power ? 1.0 : rough <= 2.0 * power ? 2.0 : 5.0;
  const double step = rough <= 5.0 * power ? factor * power : 10.0 * power;
  std::vector<double> ticks;
  for (int i = 0; ticks.empty() || ticks.back() < most; ++i) ticks.push_back(i * step);
  return ticks;
}

std::string Number(double value) { return absl::StrFormat("%.6g", value); }

double Largest(const std::vector<double>& values) {
  return *std::max_element(values.begin(), values.end());
}

}  // namespace

std::string DrawChart(const Chart& chart) {
  constexpr double kLeft = 70, kTop = 48, kWidth = 480, kHeight = 300, kBottom = kTop + kHeight;
  Svg svg(780, 410);
  svg.Text(kLeft, 26, "start", chart.title, kInk, "font-weight=\"bold\" font-size=\"15\"");
  double most = 0.0;
  for (const Curve& curve : chart.curves) most = std::max(most, Largest(curve.y));
  const std::vector<double> ys = TicksTo(most);
  const auto up = [&](double y) { return kBottom - kHeight * y / ys.back(); };
  for (const double y : ys) {
    svg.Line(kLeft, up(y), kLeft + kWidth, up(y), kGrid);
    svg.Text(kLeft - 8, up(y) + 4, "end", Number(y), kInk);
  }
  const double low = chart.x.front();
  const double high = Largest(chart.x);
  const std::vector<double> xs = chart.logarithmic_x ? chart.x : TicksTo(high);
  const auto across = [&](double x) {
    const double share =
        chart.logarithmic_x ? std::log(x / low) / std::log(high / low) : x / xs.back();
    return kLeft + kWidth * share;
  };
  for (const double x : xs) {
    svg.Line(across(x), kTop, across(x), kBottom, kGrid);
    svg.Text(across(x), kBottom + 18, "middle", Number(x), kInk);
  }
  svg.Text(kLeft + kWidth / 2, kBottom + 42, "middle", chart.x_title, kInk);
  svg.Text(18, kTop + kHeight / 2, "middle", chart.y_title, kInk,
           absl::StrFormat("transform=\"rotate(-90 18 %.0f)\"", kTop + kHeight / 2).c_str());
  // Places the names at the right, in the order of the lines' ends, so that they do not overlap.
  std::vector<std::pair<double, size_t>> ends;
  for (size_t i = 0; i < chart.curves.size(); ++i) {
    std::vector<double> x, y;
    for (size_t p = 0; p < chart.x.size(); ++p) {
      x.push_back(across(chart.x[p]));
      y.push_back(up(chart.curves[i].y[p]));
    }
    svg.Curve(x, y, Color(i));
    ends.emplace_back(y.back(), i);
  }
  std::sort(ends.begin(), ends.end());
  double next = 0.0;
  for (const auto& [y, i] : ends) {
    const double at = std::max(y + 4.0, next);
    svg.Text(kLeft + kWidth + 14, at, "start", chart.curves[i].name, Color(i));
    next = at + 17.0;
  }
  return std::move(svg).Take();
}

std::string DrawBars(const std::string& title, const std::string& unit,
                     const std::vector<std::string>& bars, const std::vector<std::string>& parts,
                     const std::vector<std::vector<double>>& values) {
  constexpr double kLeft = 20, kWidth = 700, kBar = 30, kStep = 66, kTop = 52;
  std::vector<double> totals(bars.size(), 0.0);
  for (const auto& row : values) {
    for (size_t b = 0; b < bars.size(); ++b) totals[b] += row[b];
  }
  const double most = Largest(totals);
  const double legend = kTop + kStep * static_cast<double>(bars.size()) + 14;
  Svg svg(820, static_cast<int>(legend) + 44);
  svg.Text(kLeft, 26, "start", absl::StrCat(title, ", ", unit), kInk,
           "font-weight=\"bold\" font-size=\"15\"");
  for (size_t b = 0; b < bars.size(); ++b) {
    const double y = kTop + kStep * static_cast<double>(b);
    svg.Text(kLeft, y + 12, "start", bars[b], kInk);
    double x = kLeft;
    for (size_t p = 0; p < parts.size(); ++p) {
      const double width = kWidth * values[p][b] / most;
      svg.Rectangle(x, y + 20, width, kBar, Color(p));
      x += width;
    }
    svg.Text(x + 8, y + 40, "start", absl::StrFormat("%.0f", totals[b]), kInk);
  }
  double x = kLeft;
  for (size_t p = 0; p < parts.size(); ++p) {
    svg.Rectangle(x, legend + 2, 12, 12, Color(p));
    svg.Text(x + 17, legend + 13, "start", parts[p], kInk);
    x += 36.0 + 7.4 * static_cast<double>(parts[p].size());
  }
  return std::move(svg).Take();
}

}  // namespace maneuver::bench
