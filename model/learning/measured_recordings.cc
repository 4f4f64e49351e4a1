#include "model/learning/measured_recordings.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "model/data/stable_hash.h"

namespace maneuver::learning {

MeasuredRecordings ChooseRecordings(const ExampleSet& set, int64_t most) {
  // Not the hash of the split: held-out recordings all have its smallest values.
  constexpr uint64_t kMeasured = 1;
  std::vector<int64_t> counts(set.recordings.size());
  for (const data::Example& example : set.examples) {
    ++counts[static_cast<size_t>(example.recording)];
  }
  std::vector<std::pair<uint64_t, size_t>> order;
  for (size_t i = 0; i < set.recordings.size(); ++i) {
    if (counts[i] == 0) continue;
    const uint64_t hash = data::StableHash(set.recordings[i].scenario_id());
    order.emplace_back(data::MixHash(hash, kMeasured), i);
  }
  std::ranges::sort(order);
  MeasuredRecordings chosen;
  for (const auto& [hash, i] : order) {
    if (chosen.examples >= most) break;
    chosen.examples += counts[i];
    chosen.indices.push_back(i);
  }
  std::ranges::sort(chosen.indices);
  return chosen;
}

}  // namespace maneuver::learning
