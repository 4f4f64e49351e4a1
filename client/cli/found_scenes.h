// Reads the recordings of matches from their datasets.

#ifndef MANEUVER_CLIENT_CLI_FOUND_SCENES_H_
#define MANEUVER_CLIENT_CLI_FOUND_SCENES_H_

#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/data/recording_index.h"
#include "model/tags/tag_query.h"

namespace maneuver::cli {

// INVALID_ARGUMENT if two of the folders have the same name: tags name datasets by it.
absl::Status CheckFolderNames(const std::vector<std::string>& folders);

// Reads recordings from dataset folders by their indexes, which it opens when they are first
// needed. Not thread-safe.
class FoundScenes {
 public:
  //   set: must outlive this object
  //   folders: of the datasets that were tagged; each bears the name that the tags give its dataset;
  //     CheckFolderNames accepts them
  FoundScenes(const tags::TagSet& set, const std::vector<std::string>& folders);

  // Returns the recording of a match as a scene. Its targets are those of the match: one or two.
  // Its prediction time is the beginning of the row, or with `at_peak` of its most surprising
  // window. Errors: NOT_FOUND if no folder has the dataset's name, or the dataset lacks the
  // recording; FAILED_PRECONDITION if the dataset is not the one that was tagged; those of
  // data::ReadDatasetManifest and of data::RecordingIndex.
  absl::StatusOr<v1::Scenario> Scene(const tags::Match& match, bool at_peak);
  // Returns the recording as it was recorded. Errors: as above.
  absl::StatusOr<v1::Scenario> Recording(const tags::Match& match);

 private:
  absl::StatusOr<const data::RecordingIndex*> IndexOf(const tags::TagFile& file);

  const tags::TagSet& set_;
  std::map<std::string, std::filesystem::path> folders_;  // by the name of the dataset
  std::map<std::pair<std::string, std::string>, data::RecordingIndex> indexes_;  // dataset, shard
};

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_FOUND_SCENES_H_
