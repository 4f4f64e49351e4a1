#include "model/data/nuscenes/keyframes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

namespace maneuver::data {
namespace {

constexpr double kSameTime = 1e-4;  // seconds; timestamps are in microseconds

}  // namespace

void AddFrames(std::span<const Keyframe> keyframes, v1::Agent* agent) {
  double latest = -HUGE_VAL;  // time of the last frame
  for (size_t i = 1; i < keyframes.size(); ++i) {
    const Keyframe& from = keyframes[i - 1];
    const Keyframe& to = keyframes[i];
    const double duration = to.time - from.time;
    if (!(duration > 0.0) || duration > kMaxKeyframeGap) continue;
    const double turn =
        std::remainder(static_cast<double>(to.heading) - from.heading, 2.0 * std::numbers::pi);
    const auto first = static_cast<int64_t>(std::ceil((from.time - kSameTime) / kFrameInterval));
    const auto last = static_cast<int64_t>(std::floor((to.time + kSameTime) / kFrameInterval));
    for (int64_t frame = first; frame <= last; ++frame) {
      const double time = static_cast<double>(frame) * kFrameInterval;
      if (time <= latest) continue;
      latest = time;
      const double share = std::clamp((time - from.time) / duration, 0.0, 1.0);
      v1::AgentState* const state = agent->add_states();
      state->set_time(time);
      state->set_x(from.x + share * (to.x - from.x));
      state->set_y(from.y + share * (to.y - from.y));
      state->set_heading(
          static_cast<float>(std::remainder(from.heading + share * turn, 2.0 * std::numbers::pi)));
      state->set_velocity_x(static_cast<float>((to.x - from.x) / duration));
      state->set_velocity_y(static_cast<float>((to.y - from.y) / duration));
    }
  }
}

}  // namespace maneuver::data
