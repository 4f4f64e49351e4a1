#include "model/data/town/layouts.h"

#include <algorithm>
#include <array>
#include <numbers>

namespace maneuver::data::town {

namespace {

struct Family {
  const char* layout;  // Place.layout
  Place (*draw)(Random&);
  double weight;
};
constexpr std::array<Family, kLayoutCount> kFamilies = {{{"straight_road", StraightRoad, 0.4},
                                                         {"curved_road", CurvedRoad, 0.8},
                                                         {"signal_crossing", SignalCrossing, 2.2},
                                                         {"stop_crossing", StopCrossing, 1.8},
                                                         {"t_junction", TJunction, 1.5},
                                                         {"turnaround", Turnaround, 1.7},
                                                         {"roundabout", Roundabout, 1.5},
                                                         {"motorway", Motorway, 0.35},
                                                         {"motorway_merge", MotorwayMerge, 0.7},
                                                         {"car_park", CarPark, 1.3}}};

}  // namespace

std::vector<std::string> LayoutNames() {
  std::vector<std::string> names;
  for (const Family& family : kFamilies) names.emplace_back(family.layout);
  return names;
}

Place DrawPlace(Random& random, const std::vector<std::string>& layouts) {
  std::array<double, kLayoutCount> weights{};
  for (int i = 0; i < kLayoutCount; ++i) {
    const bool drawn =
        layouts.empty() || std::ranges::find(layouts, kFamilies[i].layout) != layouts.end();
    weights[i] = drawn ? kFamilies[i].weight : 0.0;
  }
  Place place = kFamilies[random.Choose(weights)].draw(random);
  place.graph.FindConflicts();
  return place;
}

void ParkAlong(Place& place, const Road& road, bool right, double share, Random& random) {
  const double edge = right ? road.right_edge() + 1.25 : road.left_edge() - 1.25;
  for (double s = 8.0; s < road.reference.length() - 6.0; s += random.Uniform(5.9, 6.8)) {
    if (!random.Chance(share)) continue;
    PathPoint at = road.reference.At(s);
    at.p = at.p + (edge + random.Normal(0.0, 0.06)) * Left(Direction(at.heading));
    at.heading += random.Normal(0.0, 0.015) + (right ? 0.0 : std::numbers::pi);
    place.parked.push_back({.pose = at,
                            .length = random.ClampedNormal(4.55, 0.3, 3.7, 5.2),
                            .width = random.ClampedNormal(1.85, 0.07, 1.65, 2.0)});
  }
}

}  // namespace maneuver::data::town
