#ifndef MANEUVER_MODEL_SCENE_FIELD_VIOLATION_H_
#define MANEUVER_MODEL_SCENE_FIELD_VIOLATION_H_

#include <cstdint>
#include <string>

namespace maneuver::scene {

// One invalid field of a message, as google.rpc.BadRequest states it.
struct FieldViolation {
  std::string field;        // path within the message, such as agents[0].states[5].x
  std::string description;  // what is wrong and what is expected
  int64_t others = 0;       // violations that a list leaves out, at its last element
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_FIELD_VIOLATION_H_
