#include "model/data/town/layouts.h"

#include <array>
#include <numbers>

namespace maneuver::data::town {

Place DrawPlace(Random& random) {
  struct Family {
    Place (*draw)(Random&);
    double weight;
  };
  static constexpr std::array<Family, kLayoutCount> kFamilies = {{{StraightRoad, 0.4},
                                                                  {CurvedRoad, 0.8},
                                                                  {SignalCrossing, 2.2},
                                                                  {StopCrossing, 1.8},
                                                                  {TJunction, 1.5},
                                                                  {Turnaround, 1.7},
                                                                  {Roundabout, 1.5},
                                                                  {Motorway, 0.35},
                                                                  {MotorwayMerge, 0.7},
                                                                  {CarPark, 1.3}}};
  std::array<double, kLayoutCount> weights{};
  for (int i = 0; i < kLayoutCount; ++i) weights[i] = kFamilies[i].weight;
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
