#include "client/load/request_mix.h"

#include <algorithm>
#include <random>
#include <utility>

#include "client/observed_scenario.h"

namespace maneuver::load {
namespace {

// Draws from 0 .. count-1, the same on every platform, unlike std::uniform_int_distribution. The
// bias is less than 2^-32.
int Draw(std::mt19937_64& random, int count) {
  return static_cast<int>((random() >> 32) * static_cast<uint64_t>(count) >> 32);
}

// Keeps `count` random targets of a scene, or all if it has fewer.
void KeepTargets(std::mt19937_64& random, int count, v1::Scenario* scene) {
  auto& targets = *scene->mutable_target_ids();
  const int kept = std::min(count, targets.size());
  for (int i = 0; i < kept; ++i) targets.SwapElements(i, i + Draw(random, targets.size() - i));
  targets.Truncate(kept);
}

}  // namespace

std::vector<v1::PredictRequest> MakeRequests(const std::vector<v1::Scenario>& scenes,
                                             const v1::PredictRequest& pattern,
                                             const RequestMix& mix) {
  std::mt19937_64 random(mix.seed);
  std::vector<v1::PredictRequest> requests(static_cast<size_t>(mix.requests), pattern);
  for (v1::PredictRequest& request : requests) {
    int wanted = mix.least_targets + Draw(random, mix.most_targets - mix.least_targets + 1);
    // A large request may contain the same scene twice.
    while (wanted > 0) {
      v1::Scenario& scene = *request.add_scenarios();
      scene = scenes[static_cast<size_t>(Draw(random, static_cast<int>(scenes.size())))];
      KeepTargets(random, wanted, &scene);
      client::StripFuture(&scene);
      wanted -= scene.target_ids_size();
    }
  }
  return requests;
}

}  // namespace maneuver::load
