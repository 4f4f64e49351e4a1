// Reads partial labels from a file and adds them to a dataset.

#ifndef MANEUVER_MODEL_DATA_LABEL_FILE_H_
#define MANEUVER_MODEL_DATA_LABEL_FILE_H_

#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// What is wrong with one line of a label file.
struct LabelProblem {
  int64_t line = 0;  // from 1
  std::string what;
};

struct CheckedLabels {
  // Each is for a moment: start_time equals end_time.
  std::vector<v1::ManeuverAnnotation> annotations;
  // Sorted by line, at most the first kMostLabelProblems. If there is any, refuse the file.
  std::vector<LabelProblem> problems;
  int64_t problem_count = 0;
};

inline constexpr size_t kMostLabelProblems = 50;

// Reads labels and checks them against the recordings of a dataset folder. The text is
// comma-separated and begins with this header, after a byte order mark if it has one:
//
//   recording,target,time,action
//   town-1-17,23,4.5,turn_left
//
// Fields may be quoted ("a, ""b"""). Lines may end in CR LF and may be empty. `time` is in seconds
// on the recording's clock. `action` is [a-z][a-z0-9_]*, at most 63 characters. A line is a problem
// if
//   - it does not parse;
//   - the folder lacks the recording, or the recording lacks the target;
//   - the target is not a vehicle, or the time is more than 0.05 s before its first state or after
//     its last one;
//   - `actions` is not empty and lacks the action;
//   - an earlier line labels the same moment of the same target.
// The returned status is an error only if the folder cannot be read.
absl::StatusOr<CheckedLabels> CheckLabels(std::string_view text,
                                          const std::filesystem::path& folder,
                                          const std::set<std::string>& actions = {});

// Makes a new dataset folder from the shards of `folder` and one shard with these annotations.
// Leaves `folder` unchanged; both share files if the file system can. ALREADY_EXISTS if `output`
// exists; INVALID_ARGUMENT without annotations; errors of ReadDatasetManifest and of files.
//   stops: asked before each shard; CANCELLED once it is true, and nothing is left. Empty: never
absl::StatusOr<v1::Dataset> AnnotateDataset(const std::filesystem::path& folder,
                                            const std::vector<v1::ManeuverAnnotation>& annotations,
                                            const std::filesystem::path& output,
                                            const std::function<bool()>& stops = {});

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_LABEL_FILE_H_
