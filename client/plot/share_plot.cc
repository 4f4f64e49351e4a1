#include "client/plot/share_plot.h"

#include <algorithm>
#include <cmath>
#include <exception>

#include "absl/strings/str_cat.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"

namespace maneuver::plot {
namespace {

constexpr Color kShareFirst = {0, 114, 178};
constexpr Color kShareSecond = {213, 94, 0};
constexpr Color kShareChanged = {255, 240, 200};
constexpr Color kShareGrid = {225, 225, 225};
constexpr Color kShareFrame = {120, 120, 120};
constexpr double kShareLetters = 9.0;
constexpr double kShareHeader = 112.0;
constexpr double kShareFooter = 56.0;
constexpr double kShareRow = 26.0;
constexpr double kShareGap = 22.0;      // between panels
constexpr double kShareMargin = 18.0;   // left and right
constexpr double kShareWidest = 330.0;  // of the names
constexpr size_t kShareMostRows = 60;
constexpr size_t kShareMostPanels = 12;
constexpr double kShareKeyWidest = 600.0;        // of a name in the key
constexpr double kSharePictureWidest = 2'400.0;  // for the sake of the subtitle and the key
constexpr char kShareNote[] = "share of the windows, %; lines: 95 %";

// Panels are narrower where there are many.
double SharePanelWidth(size_t panels) { return panels == 1 ? 560.0 : panels <= 4 ? 280.0 : 190.0; }

double MostShare(const SharePlot& shares) {
  double most = 0.01;
  for (const SharePanel& panel : shares.panels) {
    for (const ShareCell& cell : panel.cells) {
      most = std::max(most, cell.share.high);
      if (cell.against) most = std::max(most, cell.against->high);
    }
  }
  return std::min(1.0, 1.05 * most);
}

void DrawShare(const PlottedShare& share, const Box& box, double most, double y, Color color,
               Canvas* canvas) {
  const auto across = [&](double value) { return box.left + box.width * value / most; };
  canvas->Stroke({{across(share.low), y}, {across(share.high), y}}, color, 2.2);
  canvas->Disc({across(share.share), y}, 4.2, color);
}

void DrawSharePanel(const SharePanel& panel, const Box& box, double most, Canvas* canvas) {
  for (size_t i = 0; i < panel.cells.size(); ++i) {
    if (!panel.cells[i].changed) continue;
    canvas->Rectangle(
        {box.left, box.top + kShareRow * static_cast<double>(i), box.width, kShareRow},
        kShareChanged);
  }
  const std::vector<double> ticks = Ticks(0.0, 100.0 * most, box.width > 400.0 ? 8 : 4);
  for (const double tick : ticks) {
    const double x = box.left + box.width * tick / (100.0 * most);
    canvas->Stroke({{x, box.top}, {x, box.bottom()}}, kShareGrid, 1.0);
    canvas->Text(TickText(tick, ticks.size() > 1 ? ticks[1] - ticks[0] : 1.0),
                 {x, box.bottom() + 8.0 + kShareLetters}, kShareLetters, kFaintInk,
                 Anchor::kCenter);
  }
  for (size_t i = 0; i < panel.cells.size(); ++i) {
    const ShareCell& cell = panel.cells[i];
    const double middle = box.top + kShareRow * (static_cast<double>(i) + 0.5);
    const double aside = cell.against ? 0.2 * kShareRow : 0.0;
    if (cell.against) DrawShare(*cell.against, box, most, middle + aside, kShareSecond, canvas);
    DrawShare(cell.share, box, most, middle - aside, kShareFirst, canvas);
  }
  canvas->Strokes({{{box.left, box.top},
                    {box.left, box.bottom()},
                    {box.right(), box.bottom()},
                    {box.right(), box.top},
                    {box.left, box.top}}},
                  kShareFrame, 1.0);
  canvas->Text(panel.title, {box.left, box.top - 24.0}, kShareLetters + 1.0, kInk, Anchor::kLeft,
               true);
  canvas->Text(panel.subtitle, {box.left, box.top - 8.0}, kShareLetters, kFaintInk);
}

// Shortens a text until it fits.
std::string FitRowName(std::string text, double width, double letters = kShareLetters) {
  if (Canvas::TextWidth(text, letters) <= width) return text;
  while (!text.empty() && Canvas::TextWidth(text + "...", letters) > width) text.pop_back();
  return text + "...";
}

// The names in the key; none if nothing is compared.
std::vector<std::string> ShareKeyNames(const SharePlot& shares) {
  if (shares.against.empty()) return {};
  return {FitRowName(shares.name, kShareKeyWidest), FitRowName(shares.against, kShareKeyWidest)};
}

// Returns the width that title, subtitle and key ask for.
//   names: width of the names of the rows
double ShareTextWidth(const SharePlot& shares, double names) {
  double key = names + Canvas::TextWidth(kShareNote, kShareLetters);
  for (const std::string& name : ShareKeyNames(shares)) {
    key += 58.0 + Canvas::TextWidth(name, kShareLetters);
  }
  const double text = std::max({key, Canvas::TextWidth(shares.title, 13.0, true),
                                Canvas::TextWidth(shares.subtitle, kShareLetters + 1.0)});
  return std::min(2.0 * kShareMargin + text, kSharePictureWidest);
}

std::string PaintShares(const SharePlot& shares) {
  double names = 60.0;
  for (const std::string& row : shares.rows) {
    names = std::max(names, Canvas::TextWidth(row, kShareLetters) + 10.0);
  }
  names = std::min(names, kShareWidest);
  const auto rows = static_cast<double>(shares.rows.size());
  const auto panels = static_cast<double>(shares.panels.size());
  const double width = SharePanelWidth(shares.panels.size());
  const double picture = std::max({700.0, 2.0 * kShareMargin + names + panels * (width + kShareGap),
                                   ShareTextWidth(shares, names)});
  Canvas canvas(static_cast<int>(std::ceil(picture)),
                static_cast<int>(std::ceil(kShareHeader + kShareRow * rows + kShareFooter)),
                kPaper);
  canvas.Text(shares.title, {kShareMargin, 34.0}, 13.0, kInk, Anchor::kLeft, true);
  canvas.Text(FitRowName(shares.subtitle, picture - 2.0 * kShareMargin, kShareLetters + 1.0),
              {kShareMargin, 56.0}, kShareLetters + 1.0, kFaintInk);
  const double bottom = kShareHeader + kShareRow * rows;
  for (size_t i = 0; i < shares.rows.size(); ++i) {
    canvas.Text(FitRowName(shares.rows[i], names - 8.0),
                {kShareMargin + names - 8.0,
                 kShareHeader + kShareRow * (static_cast<double>(i) + 0.5) + kShareLetters / 2.0},
                kShareLetters, kInk, Anchor::kRight);
  }
  const double most = MostShare(shares);
  double left = kShareMargin + names;
  for (const SharePanel& panel : shares.panels) {
    DrawSharePanel(panel, {left, kShareHeader, width, bottom - kShareHeader}, most, &canvas);
    left += width + kShareGap;
  }
  double at = kShareMargin + names;
  const auto key = [&](Color color, const std::string& text) {
    canvas.Stroke({{at, bottom + 40.0}, {at + 24.0, bottom + 40.0}}, color, 2.2);
    canvas.Disc({at + 12.0, bottom + 40.0}, 4.2, color);
    canvas.Text(text, {at + 32.0, bottom + 40.0 + kShareLetters / 2.0}, kShareLetters, kInk);
    at += 32.0 + Canvas::TextWidth(text, kShareLetters) + 26.0;
  };
  const std::vector<std::string> compared = ShareKeyNames(shares);
  if (!compared.empty()) {
    key(kShareFirst, compared[0]);
    key(kShareSecond, compared[1]);
  }
  canvas.Text(kShareNote, {at, bottom + 40.0 + kShareLetters / 2.0}, kShareLetters, kFaintInk);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawShares(const SharePlot& shares) {
  if (shares.rows.empty() || shares.panels.empty()) {
    return absl::InvalidArgumentError("nothing to draw: there are no shares");
  }
  if (shares.rows.size() > kShareMostRows || shares.panels.size() > kShareMostPanels) {
    return absl::InvalidArgumentError(absl::StrCat("too much for a picture: at most ",
                                                   kShareMostRows, " rows and ", kShareMostPanels,
                                                   " panels fit"));
  }
  for (const SharePanel& panel : shares.panels) {
    if (panel.cells.size() != shares.rows.size()) {
      return absl::InvalidArgumentError("a panel has not one cell for each row");
    }
  }
  try {
    return PaintShares(shares);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the shares: ", error.what()));
  }
}

}  // namespace maneuver::plot
