// Finds which recordings belong together, and divides them into folds.
//
// A model that learned from a place or a drive must not be measured on another recording of the
// same place or drive, because it has already seen the answer. Cross-validation therefore keeps
// groups of recordings together. Two recordings are in one group if a chain of these links joins
// them:
//   - they are parts of one recording: their ids without the part are the same (recording_split.h);
//   - they share a place: a lane centreline, road line or road edge of at least kLeastSharedLength
//     is in both maps, that is, it has the same type and the same number of points, and each of its
//     two ends lies within 1 m along x and y. Recordings of one drive can differ by decimetres:
//     each localises its map anew. Ends up to 2 m apart may match as well;
//   - they share an agent: the same agent id makes the same step, from one position to the next,
//     each rounded to 0.01 m. Steps shorter than 0.1 m do not count, and neither does the time:
//     recordings of one drive may have clocks of their own.

#ifndef MANEUVER_MODEL_DATA_RECORDING_GROUPS_H_
#define MANEUVER_MODEL_DATA_RECORDING_GROUPS_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// Shorter map features may match by chance.
inline constexpr double kLeastSharedLength = 20.0;  // metres

// Recordings are numbered in the order in which they were added.
struct RecordingGroups {
  std::vector<std::string> ids;  // scenario_id of each recording
  std::vector<int> groups;       // group of each recording, 0 .. count - 1 by first appearance
  int count = 0;

  // Returns the number of recordings in the largest group.
  int LargestGroup() const;
};

// Finds the groups of recordings that are added one by one. Keeps at most 3,073 hashes per
// recording, and at most kMostHashes of places and steps in all. When that number is reached, it
// keeps only half of all hash values, then a quarter, and so on. The value of a hash decides, so
// recordings that share many hashes still share some. A hash of the id is always kept. Further
// passes over the same recordings find the links by the other hashes (NextPass). Not thread-safe.
class RecordingGrouper {
 public:
  static constexpr size_t kBytesPerHash = 40;  // of memory, about
  static constexpr size_t kMostHashes = size_t{1} << 22;

  //   most_hashes: replaces kMostHashes
  explicit RecordingGrouper(size_t most_hashes = kMostHashes) : most_hashes_(most_hashes) {}

  void Add(const v1::Scenario& recording);

  // Begins a pass that keeps other hashes than all passes before it. If it returns true, add the
  // same recordings in the same order again. It returns false if no hashes are left: the groups are
  // then those that unlimited hashes give.
  bool NextPass();

  RecordingGroups Groups() const;

 private:
  int Root(int recording) const;
  // Joins the recording that is added with the first one in `first` that has this hash.
  void Link(uint64_t hash, std::unordered_map<uint64_t, int>& first);
  // Does the same by a hash of a place or a step, unless it is no longer kept.
  void LinkKept(uint64_t hash);
  bool Keeps(uint64_t hash) const;

  std::vector<std::string> ids_;
  std::vector<int> parents_;  // parent of each recording in a forest; a root is its own parent
  size_t most_hashes_;
  // A hash of a place or a step is kept if its lowest `halvings_` bits are the number of the pass.
  int halvings_ = 0;
  uint64_t pass_ = 0;
  int added_ = -1;  // the latest recording in this pass
  // The first recording that has a hash.
  std::unordered_map<uint64_t, int> first_by_id_;
  std::unordered_map<uint64_t, int> first_;  // key: hash of a place or a step
};

// Returns the fold of each recording, 0 .. folds - 1. Groups stay whole. They are assigned from the
// largest to the smallest, each to the fold with the fewest recordings so far. Groups of equal size
// are ordered by a hash of the seed and of their recordings' ids, so the order of the recordings
// does not matter. INVALID_ARGUMENT for fewer than two folds; FAILED_PRECONDITION for fewer groups
// than folds.
absl::StatusOr<std::vector<int>> AssignFolds(const RecordingGroups& groups, int folds,
                                             uint64_t seed);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_RECORDING_GROUPS_H_
