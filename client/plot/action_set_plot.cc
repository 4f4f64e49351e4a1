#include "client/plot/action_set_plot.h"

#include <algorithm>
#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "client/plot/picture_size.h"
#include "client/plot/trajectory_points.h"

namespace maneuver::plot {
namespace {

constexpr double kSetHeader = 80.0;  // pixels over the whole, with one row of the key
constexpr double kKeyRow = 22.0;
constexpr double kKeyBaseline = 62.0;  // of the first row
constexpr double kKeyLetters = 10.0;
constexpr double kNoteLetters = 9.0;
constexpr char kNote[] = "axes in metres, ahead and left; share: mean p(y|s) in validation";
constexpr double kLeastSide = 4.0;  // metres that a panel shows at least, along each axis

absl::Status DrawAction(const v1::Action& action, const Box& cell, Canvas* canvas) {
  const std::string what = absl::StrCat("a trajectory of action ", action.action_id());
  const auto mean = PointsOf(action.distribution().mean_trajectory(), what);
  if (!mean.ok()) return mean.status();
  std::vector<Points> sigma;
  for (const v1::Trajectory& trajectory : action.distribution().sigma_trajectories()) {
    auto points = PointsOf(trajectory, what);
    if (!points.ok()) return points.status();
    sigma.push_back(*std::move(points));
  }

  Extent extent;
  for (const scene::Point2& p : *mean) extent.Include(p.x, p.y);
  for (const Points& points : sigma) {
    for (const scene::Point2& p : points) extent.Include(p.x, p.y);
  }
  const double margin =
      0.06 * std::max({extent.max_x - extent.min_x, extent.max_y - extent.min_y, kLeastSide});
  for (auto [low, high] :
       {std::pair(&extent.min_x, &extent.max_x), std::pair(&extent.min_y, &extent.max_y)}) {
    const double middle = (*low + *high) / 2.0;
    const double half = std::max(*high - *low, kLeastSide) / 2.0 + margin;
    *low = middle - half;
    *high = middle + half;
  }

  const Box box{cell.left + 50.0, cell.top + 34.0, cell.width - 64.0, cell.height - 66.0};
  const Axes axes(box, extent);
  const AxesStyle style{{120, 120, 120}, kFaintInk, {236, 236, 236}, 8.0, 46.0, false};
  canvas->ClipTo(box);
  axes.DrawGrid(style, canvas);
  // The first sigma point is the mean; then each dimension has two points.
  for (size_t i = 1; i < sigma.size(); ++i) {
    canvas->Stroke(ToPixels(axes, sigma[i]), LatentColor(static_cast<int>(i - 1) / 2), 1.5, 0.85);
  }
  canvas->Stroke(ToPixels(axes, *mean), kInk, 2.6);
  canvas->Disc(axes.ToPixel(0.0, 0.0), 3.4, kInk);
  canvas->ClipToAll();
  axes.DrawFrame(style, canvas);

  const std::string id = absl::StrCat(action.action_id());
  const double baseline = cell.top + 24.0;
  canvas->Text(id, {box.left, baseline}, 12.0, action.effective() ? kInk : kFaintInk, Anchor::kLeft,
               true);
  const std::string usage = absl::StrFormat("%.1f %%", 100.0 * action.usage());
  canvas->Text(usage, {box.right(), baseline}, 10.0, kFaintInk, Anchor::kRight);
  // A long name has smaller letters, so that it ends before the usage.
  const double left = box.left + Canvas::TextWidth(id, 12.0, true) + 10.0;
  const double room = box.right() - Canvas::TextWidth(usage, 10.0) - 12.0 - left;
  const double width = Canvas::TextWidth(action.display_name(), 10.0);
  canvas->Text(action.display_name(), {left, baseline}, 10.0 * std::clamp(room / width, 0.5, 1.0),
               kInk);
  return absl::OkStatus();
}

// Explains the colours: "mean", then "z1 +/-1 sigma" and so on, in as many rows as needed. The note
// follows at the right of the last row.
class Key {
 public:
  Key(int dimensions, double width) : right_(width - 14.0) {
    double left = kLeft;
    for (int i = -1; i < dimensions; ++i) {
      Entry entry{i < 0 ? "mean" : absl::StrCat("z", i + 1, " +/-1 sigma"),
                  i < 0 ? kInk : LatentColor(i)};
      const double end = 30.0 + Canvas::TextWidth(entry.text, kKeyLetters);
      if (left + end > right_) {
        left = kLeft;
        ++rows_;
      }
      entry.left = left;
      entry.row = rows_ - 1;
      left += end + 22.0;
      entries_.push_back(std::move(entry));
    }
    if (left + Canvas::TextWidth(kNote, kNoteLetters) > right_) ++rows_;
  }

  // Returns the height of the rows beyond the first, pixels.
  double ExtraHeight() const { return (rows_ - 1) * kKeyRow; }

  void Draw(Canvas* canvas) const {
    for (const Entry& entry : entries_) {
      const double baseline = kKeyBaseline + entry.row * kKeyRow;
      const double y = baseline - kKeyLetters / 2.0;
      canvas->Stroke({{entry.left, y}, {entry.left + 22.0, y}}, entry.color, 2.6);
      canvas->Text(entry.text, {entry.left + 30.0, baseline}, kKeyLetters, kInk);
    }
    canvas->Text(kNote, {right_, kKeyBaseline + ExtraHeight()}, kNoteLetters, kFaintInk,
                 Anchor::kRight);
  }

 private:
  static constexpr double kLeft = 20.0;
  struct Entry {
    std::string text;
    Color color;
    double left = 0.0;
    int row = 0;
  };
  double right_;
  std::vector<Entry> entries_;
  int rows_ = 1;
};

absl::StatusOr<std::string> PaintActionSet(const v1::ActionSet& actions,
                                           const ActionSetPlotOptions& options) {
  std::vector<const v1::Action*> shown;
  for (const v1::Action& action : actions.actions()) {
    if (action.effective() || options.all) shown.push_back(&action);
  }
  const bool none_effective = shown.empty();
  if (none_effective) {
    for (const v1::Action& action : actions.actions()) shown.push_back(&action);
  }
  if (shown.empty()) {
    return absl::InvalidArgumentError("nothing to draw: the action set is empty");
  }
  const GridShape grid = ShapeOf(static_cast<int>(shown.size()));
  const int width = options.width > 0 ? options.width : std::max(900, 330 * grid.columns);
  const int dimensions = (shown.front()->distribution().sigma_trajectories_size() - 1) / 2;
  const Key key(dimensions, width);
  const double header = kSetHeader + key.ExtraHeight();
  const int height =
      options.height > 0 ? options.height : static_cast<int>(header) + 270 * grid.rows + 10;
  absl::Status status = CheckSize(width, height);
  if (!status.ok()) return status;

  Canvas canvas(width, height, kPaper);
  const double horizon =
      actions.waypoint_times().empty() ? 0.0 : *actions.waypoint_times().rbegin();
  const std::string title = absl::StrFormat(
      "%s   %d %s of %d, %g s", actions.model_version(), static_cast<int>(shown.size()),
      options.all || none_effective ? "actions" : "effective actions", actions.actions_size(),
      horizon);
  canvas.Text(title, {20.0, 34.0}, 13.0, kInk, Anchor::kLeft, true);
  key.Draw(&canvas);
  const Box whole{0.0, header, static_cast<double>(width), height - header - 6.0};
  for (size_t i = 0; i < shown.size(); ++i) {
    status = DrawAction(*shown[i], CellOf(grid, static_cast<int>(i), whole), &canvas);
    if (!status.ok()) return status;
  }
  return canvas.EncodePng();
}

}  // namespace

absl::StatusOr<std::string> DrawActionSet(const v1::ActionSet& actions,
                                          const ActionSetPlotOptions& options) {
  try {
    return PaintActionSet(actions, options);
  } catch (const std::exception& error) {  // OpenCV's exceptions end here
    return absl::InternalError(absl::StrCat("cannot draw the action set: ", error.what()));
  }
}

}  // namespace maneuver::plot
