// What to do with damage.

#ifndef MANEUVER_MODEL_DATA_ON_DAMAGE_H_
#define MANEUVER_MODEL_DATA_ON_DAMAGE_H_

namespace maneuver::data {

// What to do with a damaged record.
enum class OnDamage { kStop, kSkip };

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ON_DAMAGE_H_
