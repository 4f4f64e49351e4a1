// Partial labels from a file, and how they come into a dataset.

#ifndef MANEUVER_MODEL_DATA_LABEL_FILE_H_
#define MANEUVER_MODEL_DATA_LABEL_FILE_H_

#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "maneuver/v1/dataset.pb.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::data {

// What is wrong with one line of a file of labels.
struct LabelProblem {
  int64_t line = 0;  // from 1
  std::string what;
};

struct CheckedLabels {
  // Each of a moment: start_time is end_time.
  std::vector<v1::ManeuverAnnotation> annotations;
  // By line, the first kMostLabelProblems of them; any means that the file is to be refused.
  std::vector<LabelProblem> problems;
  int64_t problem_count = 0;
};

inline constexpr size_t kMostLabelProblems = 50;

// Reads labels and holds them against the recordings of a dataset folder:
//
//   recording,target,time,action
//   town-1-17,23,4.5,turn_left
//
// comma-separated, with this line first; fields may be quoted ("a, ""b"""), lines may end in CR LF
// and be empty. `time` is in seconds on the recording's clock; `action` is [a-z][a-z0-9_]*, at most
// 63 characters. A line is a problem that does not parse, names a recording that the folder does
// not have, a target that the recording does not have or that is no vehicle, a time at which the
// target is not there, an action that is not in `actions` (empty: any will do), or the same moment
// of the same target as a line before. An error is of the folder.
absl::StatusOr<CheckedLabels> CheckLabels(std::string_view text,
                                          const std::filesystem::path& folder,
                                          const std::set<std::string>& actions = {});

// Makes a new dataset folder of the shards of another and one with these annotations. The other is
// left as it is; where the disk can, both have the same files. ALREADY_EXISTS if `output` exists;
// INVALID_ARGUMENT without annotations.
absl::StatusOr<v1::Dataset> AnnotateDataset(const std::filesystem::path& folder,
                                            const std::vector<v1::ManeuverAnnotation>& annotations,
                                            const std::filesystem::path& output);

}  // namespace maneuver::data

#endif  // MANEUVER_MODEL_DATA_LABEL_FILE_H_
