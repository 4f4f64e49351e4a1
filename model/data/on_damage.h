// Says how a reader treats damage.

#ifndef MANEUVER_MODEL_DATA_ON_DAMAGE_H_
#define MANEUVER_MODEL_DATA_ON_DAMAGE_H_

namespace maneuver::data {

// Whether a reader stops at a damaged record or skips it.
enum class OnDamage { kStop, kSkip };

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_ON_DAMAGE_H_
