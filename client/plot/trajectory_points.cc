#include "client/plot/trajectory_points.h"

#include "absl/strings/str_cat.h"
#include "client/plot/label_placer.h"

namespace maneuver::plot {

absl::StatusOr<Points> PointsOf(const v1::Trajectory& trajectory, const std::string& what) {
  if (trajectory.x_size() != trajectory.y_size()) {
    return absl::InvalidArgumentError(absl::StrCat(what, " has unequal numbers of x and y"));
  }
  Points points = {{0.0, 0.0}};
  for (int i = 0; i < trajectory.x_size(); ++i) {
    points.push_back({trajectory.x(i), trajectory.y(i)});
  }
  return points;
}

Line ToPixels(const Axes& axes, const Points& points) {
  Line line;
  for (const scene::Point2& p : points) line.push_back(axes.ToPixel(p.x, p.y));
  return line;
}

void DrawActionIds(const Box& whole, const std::vector<ActionEnd>& ends, const ActionIdStyle& style,
                   Canvas* canvas) {
  LabelPlacer placer(whole);
  for (const ActionEnd& end : ends) {
    placer.Occupy(
        {end.pixel.x - style.dot / 2.0, end.pixel.y - style.dot / 2.0, style.dot, style.dot});
  }
  for (const ActionEnd& end : ends) {
    const std::string id = absl::StrCat(end.id);
    const auto place = placer.Place(end.pixel, id, style.letters, style.farthest);
    if (!place) continue;
    if (place->gap > style.least_gap) {
      const Pixel middle = {place->frame.left + place->frame.width / 2.0,
                            place->frame.top + place->frame.height / 2.0};
      canvas->Stroke({end.pixel, middle}, kInk, 0.8, style.opacity);
    }
    canvas->Rectangle(place->frame, kPaper, 0.85);
    canvas->Text(id, place->baseline, style.letters, kInk, Anchor::kCenter, true);
  }
}

}  // namespace maneuver::plot
