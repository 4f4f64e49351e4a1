#include "client/plot/action_gallery_plot.h"

#include <algorithm>
#include <exception>
#include <map>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/picture_size.h"
#include "client/plot/trajectory_points.h"

namespace maneuver::plot {
namespace {

constexpr double kGalleryHeader = 74.0;   // pixels over the panels
constexpr double kGalleryLegend = 250.0;  // pixels at the right, at least
constexpr double kGalleryLetters = 9.0;
constexpr double kGalleryLeastRow = 15.0;  // of the legend, so that its letters do not touch
constexpr double kLeastMetres = 4.0;       // that a panel shows along each axis

// An action in one panel.
struct GalleryLine {
  int id;
  Color color;
  Points points;
};

// Returns the actions to draw, most used first, the same in every panel.
std::vector<const v1::Action*> Shown(const v1::ActionSet& set, bool all) {
  std::vector<const v1::Action*> shown;
  for (const v1::Action& action : set.actions()) {
    if (action.effective() || all) shown.push_back(&action);
  }
  if (shown.empty()) {
    for (const v1::Action& action : set.actions()) shown.push_back(&action);
  }
  std::stable_sort(shown.begin(), shown.end(), [](const v1::Action* a, const v1::Action* b) {
    return a->usage() > b->usage();
  });
  return shown;
}

absl::StatusOr<std::vector<GalleryLine>> LinesOf(const v1::ActionSet& set,
                                                 const std::map<int, Color>& colors) {
  std::vector<GalleryLine> lines;
  for (const v1::Action& action : set.actions()) {
    const auto color = colors.find(action.action_id());
    if (color == colors.end()) continue;
    auto points = PointsOf(action.distribution().mean_trajectory(),
                           absl::StrCat("the mean of action ", action.action_id()));
    if (!points.ok()) return points.status();
    lines.push_back({action.action_id(), color->second, *std::move(points)});
  }
  return lines;
}

Extent ExtentOf(const std::vector<GalleryLine>& lines, double kept) {
  Extent extent;
  extent.Include(kept, 0.0);
  for (const GalleryLine& line : lines) {
    for (const scene::Point2& p : line.points) extent.Include(p.x, p.y);
  }
  const double width = std::max(extent.max_x - extent.min_x, kLeastMetres);
  const double height = std::max(extent.max_y - extent.min_y, kLeastMetres);
  const double margin = 0.06 * std::max(width, height);
  const double x = (extent.min_x + extent.max_x) / 2.0;
  const double y = (extent.min_y + extent.max_y) / 2.0;
  return {x - width / 2.0 - margin, x + width / 2.0 + margin, y - height / 2.0 - margin,
          y + height / 2.0 + margin};
}

void DrawPanel(const std::vector<GalleryLine>& lines, double speed, double horizon, const Box& cell,
               Canvas* canvas) {
  const Box box{cell.left + 56.0, cell.top + 30.0, cell.width - 76.0, cell.height - 78.0};
  const double kept = speed * horizon;
  const Axes axes(box, ExtentOf(lines, kept));
  const AxesStyle style{{120, 120, 120}, kFaintInk, {236, 236, 236}, 8.0, 60.0, true};
  canvas->ClipTo(box);
  axes.DrawGrid(style, canvas);
  // The most used action comes last, above the others.
  for (auto line = lines.rbegin(); line != lines.rend(); ++line) {
    const Line pixels = ToPixels(axes, line->points);
    canvas->Stroke(pixels, kPaper, 4.4, 0.9);
    canvas->Stroke(pixels, line->color, 2.6);
    canvas->Disc(pixels.back(), 3.6, line->color);
  }
  canvas->Dashes(ToPixels(axes, {{0.0, 0.0}, {kept, 0.0}}), kInk, 1.4, 7.0, 5.0);
  canvas->Disc(axes.ToPixel(0.0, 0.0), 3.6, kInk);
  std::vector<ActionEnd> ends;
  for (const GalleryLine& line : lines) {
    ends.push_back({line.id, axes.ToPixel(line.points.back().x, line.points.back().y)});
  }
  DrawActionIds(box, ends,
                {.dot = 8.0, .letters = 9.0, .farthest = 70.0, .least_gap = 10.0, .opacity = 0.6},
                canvas);
  canvas->ClipToAll();
  axes.DrawFrame(style, canvas);
  canvas->Text(absl::StrFormat("%g m/s", speed), {box.left, cell.top + 20.0}, 12.0, kInk,
               Anchor::kLeft, true);
}

// As wide as the longest name asks for, but never more than a third of the picture.
double GalleryLegendWidth(const std::vector<const v1::Action*>& actions, double picture) {
  double longest = 0.0;
  for (const v1::Action* action : actions) {
    longest = std::max(longest, Canvas::TextWidth(action->display_name(), kGalleryLetters));
  }
  return std::clamp(longest + 150.0, kGalleryLegend, std::max(kGalleryLegend, picture / 3.0));
}

// Lists the most used actions, as many as fit, and says how many it leaves out.
void DrawGalleryLegend(const std::vector<const v1::Action*>& actions,
                       const std::map<int, Color>& colors, const Box& box, Canvas* canvas) {
  constexpr double kLetters = kGalleryLetters;
  const auto rows = static_cast<size_t>(box.height / kGalleryLeastRow);
  const bool all_fit = actions.size() + 1 <= rows;
  const size_t listed = all_fit ? actions.size() : rows - 2;  // without the title and the note
  const double row = std::min(22.0, box.height / static_cast<double>(listed + (all_fit ? 1 : 2)));
  double y = box.top + row / 2.0;
  canvas->Text("action", {box.left, y + kLetters / 2.0}, 8.5, kFaintInk);
  canvas->Text("usage", {box.right(), y + kLetters / 2.0}, 8.5, kFaintInk, Anchor::kRight);
  for (const v1::Action* action : std::span(actions).first(listed)) {
    y += row;
    const double baseline = y + kLetters / 2.0;
    canvas->Stroke({{box.left, y}, {box.left + 20.0, y}}, colors.at(action->action_id()), 3.0);
    canvas->Text(absl::StrCat(action->action_id()), {box.left + 46.0, baseline}, kLetters, kInk,
                 Anchor::kRight, true);
    const std::string usage = absl::StrFormat("%.1f %%", 100.0 * action->usage());
    canvas->Text(usage, {box.right(), baseline}, kLetters, kFaintInk, Anchor::kRight);
    // A long name has smaller letters, so that it ends before the usage.
    const double room = box.width - 56.0 - 10.0 - Canvas::TextWidth(usage, kLetters);
    canvas->Text(action->display_name(), {box.left + 56.0, baseline},
                 Canvas::HeightToFit(action->display_name(), kLetters, room), kInk);
  }
  if (all_fit) return;
  canvas->Text(absl::StrCat("and ", actions.size() - listed, " more"),
               {box.left + 56.0, y + row + kLetters / 2.0}, kLetters, kFaintInk);
}

absl::StatusOr<std::string> PaintActionGallery(std::span<const v1::ActionSet> sets,
                                               const ActionGalleryOptions& options) {
  if (sets.empty()) return absl::InvalidArgumentError("nothing to draw: there is no action set");
  for (const v1::ActionSet& set : sets) {
    if (!set.has_speed() || set.actions().empty()) {
      return absl::InvalidArgumentError("nothing to draw: an action set has no speed or no action");
    }
  }
  if (const absl::Status status = CheckSize(options.width, options.height); !status.ok()) {
    return status;
  }
  const std::vector<const v1::Action*> shown = Shown(sets.front(), options.all);
  std::map<int, Color> colors;
  for (const v1::Action* action : shown) {
    const int rank = static_cast<int>(colors.size());
    colors.emplace(action->action_id(), LatentColor(rank % kLatentColors));
  }

  Canvas canvas(options.width, options.height, kPaper);
  const auto& times = sets.front().waypoint_times();
  const double horizon = times.empty() ? 0.0 : *times.rbegin();
  canvas.Text(absl::StrFormat("%s   %d actions of %d, %g s", sets.front().model_version(),
                              static_cast<int>(shown.size()), sets.front().actions_size(), horizon),
              {20.0, 32.0}, 13.0, kInk, Anchor::kLeft, true);
  canvas.Text(
      "generic mean of each action for a target that drives straight on at the speed of the "
      "panel; dashed: it keeps its speed",
      {20.0, 56.0}, 10.0, kFaintInk);
  const double legend = GalleryLegendWidth(shown, options.width);
  const Box panels{0.0, kGalleryHeader, options.width - legend, options.height - kGalleryHeader};
  const GridShape grid = ShapeOf(static_cast<int>(sets.size()));
  for (size_t i = 0; i < sets.size(); ++i) {
    const auto lines = LinesOf(sets[i], colors);
    if (!lines.ok()) return lines.status();
    DrawPanel(*lines, sets[i].speed(), horizon, CellOf(grid, static_cast<int>(i), panels), &canvas);
  }
  DrawGalleryLegend(shown, colors,
                    {panels.right() + 10.0, panels.top + 30.0, legend - 30.0, panels.height - 60.0},
                    &canvas);
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawActionGallery(std::span<const v1::ActionSet> sets,
                                              const ActionGalleryOptions& options) {
  try {
    return PaintActionGallery(sets, options);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the actions: ", error.what()));
  }
}

}  // namespace maneuver::plot
