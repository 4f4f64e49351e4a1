#include "model/learning/variation.h"

#include <cmath>

#include "model/data/stable_hash.h"

namespace maneuver::learning {
namespace {

using data::MixHash;
using data::SplitMix64;
using data::UnitInterval;

// Strengths of sensor noise, each drawn evenly in its logarithm.
constexpr double kLeastSpeedNoise = 0.03, kMostSpeedNoise = 0.5;        // m/s
constexpr double kLeastHeadingNoise = 0.001, kMostHeadingNoise = 0.02;  // radians

double Between(double least, double most, double share) {
  return least * std::pow(most / least, share);
}

}  // namespace

std::function<bool(int64_t)> HiddenAgents(const Variation& variation) {
  if (variation.drop_agents <= 0.0) return {};
  return [share = variation.drop_agents, seed = variation.drop_seed](int64_t agent_id) {
    return UnitInterval(MixHash(seed, static_cast<uint64_t>(agent_id))) < share;
  };
}

bool IsLeftOut(const Variation& variation, int place) {
  // Other numbers than those of HiddenAgents, which are for ids.
  constexpr uint64_t kPlaces = 1;
  const uint64_t seed = MixHash(SplitMix64(variation.drop_seed), kPlaces);
  return variation.drop_agents > 0.0 &&
         UnitInterval(MixHash(seed, static_cast<uint64_t>(place))) < variation.drop_agents;
}

Variation DrawVariation(const v1::AugmentationSettings& settings, int history_frames, uint64_t seed,
                        int epoch, int64_t example) {
  uint64_t state = MixHash(MixHash(SplitMix64(seed), static_cast<uint64_t>(epoch)),
                           static_cast<uint64_t>(example));
  const auto draw = [&state] { return UnitInterval(state = SplitMix64(state)); };
  Variation variation;
  variation.mirror = draw() < 0.5 && settings.mirror();
  variation.scale = 1.0 + settings.scale() * (2.0 * draw() - 1.0);
  variation.shift_x = settings.shift_pixels() * (2.0 * draw() - 1.0);
  variation.shift_y = settings.shift_pixels() * (2.0 * draw() - 1.0);
  variation.rotation = settings.rotation() * (2.0 * draw() - 1.0);
  variation.drop_agents = settings.drop_agents();
  variation.drop_seed = state = SplitMix64(state);
  if (draw() < settings.drop_history()) {
    variation.frames = 1 + static_cast<int>(draw() * history_frames);
  }
  if (draw() < settings.sensor_noise()) {
    variation.noise.speed_stddev = Between(kLeastSpeedNoise, kMostSpeedNoise, draw());
    variation.noise.heading_stddev = Between(kLeastHeadingNoise, kMostHeadingNoise, draw());
    variation.noise.seed = state = SplitMix64(state);
  }
  return variation;
}

void ApplyVariation(const Variation& variation, std::span<float> trajectory) {
  const float side = variation.mirror ? -1.0F : 1.0F;
  const float c = static_cast<float>(variation.scale * std::cos(variation.rotation));
  const float s = static_cast<float>(variation.scale * std::sin(variation.rotation));
  for (size_t i = 0; i + 1 < trajectory.size(); i += 2) {
    const float x = trajectory[i];
    const float y = trajectory[i + 1];
    trajectory[i] = c * x + s * y;
    trajectory[i + 1] = side * (c * y - s * x);
  }
}

scene::MotionInputs VariedMotion(const Variation& variation, const scene::MotionInputs& motion) {
  const scene::MotionInputs scaled = scene::Scaled(motion, variation.scale);
  return variation.mirror ? scene::Mirrored(scaled) : scaled;
}

}  // namespace maneuver::learning
