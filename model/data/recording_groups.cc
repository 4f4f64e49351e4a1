#include "model/data/recording_groups.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <tuple>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "model/data/recording_split.h"
#include "model/data/stable_hash.h"

namespace maneuver::data {
namespace {

// Seeds that keep hashes of different kinds apart.
constexpr uint64_t kIdSeed = 0x6964;
constexpr uint64_t kPlaceSeed = 0x706C616365;
constexpr uint64_t kAgentSeed = 0x6167656E74;

constexpr double kEndTolerance = 1.0;   // metres
constexpr double kStepRounding = 0.01;  // metres
constexpr double kLeastStep = 0.1;      // metres
// The hashes kept: 16 for each of the longest features, and the smallest hashes of steps. Two
// recordings that share a place or a drive then keep the same ones.
constexpr size_t kMostFeatures = 128;
constexpr size_t kMostSteps = 1024;

uint64_t MixNumber(uint64_t hash, double value) {
  return MixHash(hash, static_cast<uint64_t>(static_cast<int64_t>(value)));
}

bool MarksAPlace(const v1::MapFeature& feature) {
  return feature.type() == v1::MAP_FEATURE_TYPE_LANE_CENTERLINE ||
         feature.type() == v1::MAP_FEATURE_TYPE_ROAD_LINE ||
         feature.type() == v1::MAP_FEATURE_TYPE_ROAD_EDGE;
}

double Length(const v1::MapFeature& feature) {
  double length = 0.0;
  for (int i = 1; i < feature.x_size(); ++i) {
    length += std::hypot(feature.x(i) - feature.x(i - 1), feature.y(i) - feature.y(i - 1));
  }
  return length;
}

// Appends the hashes of a feature. They name the cells that its ends lie in, on two grids per
// coordinate that are staggered by half a cell. Two numbers that differ by less than half a cell
// share a cell in one of the two grids. Four coordinates make 16 combinations.
void AppendHashes(const v1::MapFeature& feature, std::vector<uint64_t>* hashes) {
  const std::array<double, 4> ends = {*feature.x().begin(), *feature.y().begin(),
                                      *feature.x().rbegin(), *feature.y().rbegin()};
  uint64_t seed = MixHash(kPlaceSeed, static_cast<uint64_t>(feature.type()));
  seed = MixHash(seed, static_cast<uint64_t>(feature.x_size()));
  for (unsigned grid = 0; grid < 1u << ends.size(); ++grid) {
    uint64_t hash = MixHash(seed, grid);
    for (size_t i = 0; i < ends.size(); ++i) {
      const double offset = (grid >> i & 1u) != 0 ? 0.5 : 0.0;
      hash = MixNumber(hash, std::floor(ends[i] / (2.0 * kEndTolerance) + offset));
    }
    hashes->push_back(hash);
  }
}

std::vector<uint64_t> HashPlaces(const v1::Scenario& recording) {
  std::vector<std::pair<double, const v1::MapFeature*>> features;  // by length
  for (const v1::MapFeature& feature : recording.map_features()) {
    if (!MarksAPlace(feature)) continue;
    const double length = Length(feature);
    if (length >= kLeastSharedLength) features.emplace_back(length, &feature);
  }
  const size_t kept = std::min(features.size(), kMostFeatures);
  std::partial_sort(features.begin(), features.begin() + static_cast<std::ptrdiff_t>(kept),
                    features.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<uint64_t> hashes;
  for (size_t i = 0; i < kept; ++i) AppendHashes(*features[i].second, &hashes);
  return hashes;
}

std::vector<uint64_t> HashSteps(const v1::Scenario& recording) {
  std::vector<uint64_t> hashes;
  for (const v1::Agent& agent : recording.agents()) {
    const uint64_t seed = MixHash(kAgentSeed, static_cast<uint64_t>(agent.id()));
    for (int i = 1; i < agent.states_size(); ++i) {
      const v1::AgentState& from = agent.states(i - 1);
      const v1::AgentState& to = agent.states(i);
      if (std::hypot(to.x() - from.x(), to.y() - from.y()) < kLeastStep) continue;
      uint64_t hash = seed;
      for (const double value : {from.x(), from.y(), to.x(), to.y()}) {
        hash = MixNumber(hash, std::round(value / kStepRounding));
      }
      hashes.push_back(hash);
    }
  }
  const size_t kept = std::min(hashes.size(), kMostSteps);
  std::nth_element(hashes.begin(), hashes.begin() + static_cast<std::ptrdiff_t>(kept),
                   hashes.end());
  hashes.resize(kept);
  return hashes;
}

// One group while it is assigned to a fold.
struct Deal {
  int size = 0;
  uint64_t hash = ~uint64_t{0};  // the smallest of its recordings', mixed with the seed
  int group = 0;
};

std::vector<Deal> LargestFirst(const RecordingGroups& groups, uint64_t seed) {
  std::vector<Deal> deals(static_cast<size_t>(groups.count));
  for (size_t i = 0; i < groups.ids.size(); ++i) {
    Deal& deal = deals[static_cast<size_t>(groups.groups[i])];
    ++deal.size;
    deal.hash = std::min(deal.hash, MixHash(StableHash(groups.ids[i]), seed));
    deal.group = groups.groups[i];
  }
  std::sort(deals.begin(), deals.end(), [](const Deal& a, const Deal& b) {
    return std::tuple(-a.size, a.hash) < std::tuple(-b.size, b.hash);
  });
  return deals;
}

}  // namespace

int RecordingGroups::LargestGroup() const {
  std::vector<int> sizes(static_cast<size_t>(count));
  for (const int group : groups) ++sizes[static_cast<size_t>(group)];
  return sizes.empty() ? 0 : *std::max_element(sizes.begin(), sizes.end());
}

void RecordingGrouper::Add(const v1::Scenario& recording) {
  ++added_;
  if (pass_ == 0) {
    parents_.push_back(added_);
    ids_.push_back(recording.scenario_id());
    Link(MixHash(StableHash(WithoutPart(recording.scenario_id())), kIdSeed), first_by_id_);
  }
  for (const uint64_t hash : HashPlaces(recording)) LinkKept(hash);
  for (const uint64_t hash : HashSteps(recording)) LinkKept(hash);
}

void RecordingGrouper::Link(uint64_t hash, std::unordered_map<uint64_t, int>& first) {
  const int earliest = first.try_emplace(hash, added_).first->second;
  const auto [low, high] = std::minmax({Root(earliest), Root(added_)});
  parents_[static_cast<size_t>(high)] = low;
}

void RecordingGrouper::LinkKept(uint64_t hash) {
  if (!Keeps(hash)) return;
  Link(hash, first_);
  // Later passes have about as many hashes as the first one has at its end.
  while (pass_ == 0 && first_.size() > most_hashes_) {
    ++halvings_;
    std::erase_if(first_, [this](const auto& each) { return !Keeps(each.first); });
  }
}

bool RecordingGrouper::Keeps(uint64_t hash) const {
  return (hash & ((uint64_t{1} << halvings_) - 1)) == pass_;
}

bool RecordingGrouper::NextPass() {
  if (pass_ + 1 == uint64_t{1} << halvings_) return false;
  ++pass_;
  added_ = -1;
  first_.clear();
  return true;
}

int RecordingGrouper::Root(int recording) const {
  while (parents_[static_cast<size_t>(recording)] != recording) {
    recording = parents_[static_cast<size_t>(recording)];
  }
  return recording;
}

RecordingGroups RecordingGrouper::Groups() const {
  RecordingGroups result{.ids = ids_, .groups = std::vector<int>(ids_.size())};
  std::unordered_map<int, int> numbers;  // of roots
  for (size_t i = 0; i < ids_.size(); ++i) {
    result.groups[i] =
        numbers.try_emplace(Root(static_cast<int>(i)), static_cast<int>(numbers.size()))
            .first->second;
  }
  result.count = static_cast<int>(numbers.size());
  return result;
}

absl::StatusOr<std::vector<int>> AssignFolds(const RecordingGroups& groups, int folds,
                                             uint64_t seed) {
  if (folds < 2) return absl::InvalidArgumentError("folds: at least 2 are needed");
  if (groups.count < folds) {
    return absl::FailedPreconditionError(
        absl::StrCat(groups.ids.size(), " recordings make ", groups.count,
                     " groups that share no place and no agent, too few for ", folds,
                     " folds; add recordings of other places, or use fewer folds"));
  }
  std::vector<int> fold_of_group(static_cast<size_t>(groups.count));
  std::vector<int> sizes(static_cast<size_t>(folds));  // recordings in each fold
  for (const Deal& deal : LargestFirst(groups, seed)) {
    const auto fewest = std::min_element(sizes.begin(), sizes.end());
    fold_of_group[static_cast<size_t>(deal.group)] = static_cast<int>(fewest - sizes.begin());
    *fewest += deal.size;
  }
  std::vector<int> fold_of;
  for (const int group : groups.groups)
    fold_of.push_back(fold_of_group[static_cast<size_t>(group)]);
  return fold_of;
}

}  // namespace maneuver::data
