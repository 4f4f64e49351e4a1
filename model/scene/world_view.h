// How a view of the world departs from the recorded world.

#ifndef MANEUVER_MODEL_SCENE_WORLD_VIEW_H_
#define MANEUVER_MODEL_SCENE_WORLD_VIEW_H_

namespace maneuver::scene {

// Used for augmentation. The default changes nothing.
struct WorldView {
  // Factor by which the map, the agents and their speeds are larger. Greater than 0.
  double scale = 1.0;
  // Left and right are swapped about the target's x axis.
  bool mirror = false;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_WORLD_VIEW_H_
