// How a world that is read departs from the recorded one.

#ifndef MANEUVER_MODEL_SCENE_WORLD_VIEW_H_
#define MANEUVER_MODEL_SCENE_WORLD_VIEW_H_

namespace maneuver::scene {

// For augmentation. The default departs in nothing.
struct WorldView {
  // The map, the agents and their speeds are so many times as large. Greater than 0.
  double scale = 1.0;
  // Left and right are swapped about the target's x axis.
  bool mirror = false;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_WORLD_VIEW_H_
