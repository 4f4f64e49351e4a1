#include "model/learning/epoch_windows.h"

#include <algorithm>
#include <utility>

#include "model/data/stable_hash.h"

namespace maneuver::learning {
namespace {

// Recordings of one folder, or of all, in an order drawn anew for each turn.
class RecordingTurns {
 public:
  RecordingTurns(std::vector<size_t> recordings, double weight, uint64_t hash)
      : recordings_(std::move(recordings)), weight_(weight), hash_(hash) {}

  size_t Peek() {
    if (next_ == recordings_.size() || turn_ == 0) BeginTurn();
    return recordings_[next_];
  }
  void Take(int64_t examples) {
    ++next_;
    taken_ += static_cast<double>(examples) / weight_;
  }
  // Examples that were taken, over the weight.
  double taken() const { return taken_; }

 private:
  void BeginTurn() {
    const uint64_t turn = data::MixHash(hash_, static_cast<uint64_t>(turn_++));
    std::ranges::sort(recordings_, {}, [turn](size_t recording) {
      return std::pair(data::MixHash(turn, recording), recording);
    });
    next_ = 0;
  }

  std::vector<size_t> recordings_;
  const double weight_;
  const uint64_t hash_;
  int turn_ = 0;
  size_t next_ = 0;
  double taken_ = 0.0;
};

std::vector<RecordingTurns> TurnsOf(std::span<const UnreadRecording> recordings,
                                    std::span<const double> weights, uint64_t hash) {
  std::vector<std::vector<size_t>> groups(std::max<size_t>(1, weights.size()));
  for (size_t i = 0; i < recordings.size(); ++i) {
    groups[weights.empty() ? 0 : static_cast<size_t>(recordings[i].folder)].push_back(i);
  }
  std::vector<RecordingTurns> turns;
  for (size_t i = 0; i < groups.size(); ++i) {
    if (groups[i].empty()) continue;
    turns.emplace_back(std::move(groups[i]), weights.empty() ? 1.0 : weights[i],
                       data::MixHash(hash, i));
  }
  return turns;
}

}  // namespace

std::vector<EpochWindow> PlanWindows(std::span<const UnreadRecording> recordings,
                                     std::span<const double> weights, const WindowSizes& sizes,
                                     uint64_t seed, int epoch) {
  // The seed is hashed first: seed 1 at epoch 2 draws otherwise than seed 2 at epoch 1.
  std::vector<RecordingTurns> turns = TurnsOf(
      recordings, weights, data::MixHash(data::SplitMix64(seed), static_cast<uint64_t>(epoch)));
  std::vector<EpochWindow> windows;
  for (int64_t steps = 0; steps < sizes.epoch_steps; steps += windows.back().steps) {
    EpochWindow window;
    window.first_step = steps;
    const int64_t left = (sizes.epoch_steps - steps) * sizes.batch_size;  // examples
    int64_t examples = 0;
    int64_t bytes = 0;
    while (examples < left) {
      RecordingTurns& turn = *std::ranges::min_element(turns, {}, &RecordingTurns::taken);
      const size_t next = turn.Peek();
      const UnreadRecording& recording = recordings[next];
      if (bytes + recording.bytes > sizes.bytes && examples >= sizes.batch_size) break;
      turn.Take(recording.examples);
      window.recordings.push_back(next);
      examples += recording.examples;
      bytes += recording.bytes;
    }
    window.steps = std::min(examples, left) / sizes.batch_size;
    windows.push_back(std::move(window));
  }
  return windows;
}

}  // namespace maneuver::learning
