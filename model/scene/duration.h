// Durations of messages as numbers.

#ifndef MANEUVER_MODEL_SCENE_DURATION_H_
#define MANEUVER_MODEL_SCENE_DURATION_H_

#include <google/protobuf/duration.pb.h>

namespace maneuver::scene {

inline double ToSeconds(const google::protobuf::Duration& duration) {
  return static_cast<double>(duration.seconds()) + 1e-9 * duration.nanos();
}

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_DURATION_H_
