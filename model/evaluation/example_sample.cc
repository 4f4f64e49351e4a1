#include "model/evaluation/example_sample.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "model/data/stable_hash.h"

namespace maneuver::evaluation {
namespace {

constexpr uint64_t kSeed = 0x53616D706C65;  // keeps these draws apart from other hashes

}  // namespace

std::vector<size_t> SampleExamples(std::span<const data::Example> examples,
                                   std::span<const v1::Scenario> recordings, size_t count) {
  std::vector<std::pair<uint64_t, size_t>> drawn;
  for (size_t i = 0; i < examples.size(); ++i) {
    const data::Example& example = examples[i];
    uint64_t hash =
        data::StableHash(recordings[static_cast<size_t>(example.recording)].scenario_id());
    hash = data::MixHash(hash, static_cast<uint64_t>(example.target_id));
    hash = data::MixHash(hash, static_cast<uint64_t>(std::llround(1e3 * example.time)));
    drawn.emplace_back(data::MixHash(hash, kSeed), i);
  }
  count = std::min(count, drawn.size());
  std::nth_element(drawn.begin(), drawn.begin() + static_cast<std::ptrdiff_t>(count), drawn.end());
  std::vector<size_t> sample;
  for (size_t i = 0; i < count; ++i) sample.push_back(drawn[i].second);
  std::sort(sample.begin(), sample.end());
  return sample;
}

}  // namespace maneuver::evaluation
