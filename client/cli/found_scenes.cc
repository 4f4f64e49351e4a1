#include "client/cli/found_scenes.h"

#include <algorithm>
#include <cmath>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/scene/target_frame.h"

namespace maneuver::cli {

namespace {

// Returns the time of the target's state that a time of the tags, in whole milliseconds, stands for.
double StateTime(const v1::Scenario& scene, int64_t target, double rounded) {
  constexpr double kHalf = 5.001e-4;
  const v1::Agent* const agent = scene::FindAgent(scene, target);
  if (agent == nullptr) return rounded;
  const auto state = std::ranges::find_if(agent->states(), [&](const v1::AgentState& each) {
    return std::abs(each.time() - rounded) <= kHalf;
  });
  return state == agent->states().end() ? rounded : state->time();
}

// Returns the path from the root, without links and dots.
std::filesystem::path WholePath(const std::string& folder) {
  std::error_code error;
  const std::filesystem::path whole = std::filesystem::weakly_canonical(folder, error);
  return error ? std::filesystem::path(folder) : whole;
}

}  // namespace

absl::Status CheckFolderNames(const std::vector<std::string>& folders) {
  std::map<std::string, std::string> named;  // folder by its name
  for (const std::string& folder : folders) {
    const std::filesystem::path whole = WholePath(folder);
    const auto [other, is_new] = named.emplace(whole.filename().string(), folder);
    if (!is_new && WholePath(other->second) != whole) {
      return absl::InvalidArgumentError(absl::StrCat("--dataset: ", other->second, " and ", folder,
                                                     " have the same name; tags tell datasets "
                                                     "apart by it"));
    }
  }
  return absl::OkStatus();
}

FoundScenes::FoundScenes(const tags::TagSet& set, const std::vector<std::string>& folders)
    : set_(set) {
  for (const std::string& folder : folders) {
    folders_[WholePath(folder).filename().string()] = folder;
  }
}

absl::StatusOr<const data::RecordingIndex*> FoundScenes::IndexOf(const tags::TagFile& file) {
  const std::pair key(file.dataset(), file.shard());
  if (const auto known = indexes_.find(key); known != indexes_.end()) return &known->second;
  const auto folder = folders_.find(file.dataset());
  if (folder == folders_.end()) {
    return absl::NotFoundError(absl::StrCat("the recordings are in the dataset ", file.dataset(),
                                            "; say where it is: --dataset FOLDER, a folder called ",
                                            file.dataset()));
  }
  const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(folder->second);
  if (!manifest.ok()) return manifest.status();
  const auto& shards = manifest->shards();
  const auto shard = std::ranges::find_if(shards, [&](const v1::Shard& each) {
    return each.file() == file.shard() && each.sha256() == file.shard_sha256();
  });
  if (shard == shards.end()) {
    return absl::FailedPreconditionError(absl::StrCat(folder->second.string(), " has no ",
                                                      file.shard(),
                                                      " as it was tagged: it is another dataset"));
  }
  absl::StatusOr<data::RecordingIndex> index =
      data::RecordingIndex::OpenShard(folder->second, *shard);
  if (!index.ok()) return index.status();
  return &indexes_.emplace(key, *std::move(index)).first->second;
}

absl::StatusOr<v1::Scenario> FoundScenes::Recording(const tags::Match& match) {
  const tags::TaggedShard& shard = set_.shards[match.shard];
  const absl::StatusOr<const data::RecordingIndex*> index = IndexOf(shard.file);
  if (!index.ok()) return index.status();
  const int64_t recording = (*index)->Find(shard.Scene(match.row));
  if (recording < 0) {
    return absl::NotFoundError(
        absl::StrCat(shard.file.shard(), " has no recording ", shard.Scene(match.row)));
  }
  return (*index)->Read(static_cast<size_t>(recording));
}

absl::StatusOr<v1::Scenario> FoundScenes::Scene(const tags::Match& match, bool at_peak) {
  absl::StatusOr<v1::Scenario> scene = Recording(match);
  if (!scene.ok()) return scene;
  const tags::ShardTags& tags = *set_.shards[match.shard].tags;
  const tags::Column time = at_peak ? tags::Column::kPeak : tags::Column::kFrom;
  const int64_t target = tags.Value(tags::Column::kTarget, match.row);
  scene->set_prediction_time(
      StateTime(*scene, target, tags::ToNumber(time, tags.Value(time, match.row))));
  scene->clear_target_ids();
  scene->add_target_ids(target);
  if (match.other) scene->add_target_ids(tags.Value(tags::Column::kTarget, *match.other));
  return scene;
}

}  // namespace maneuver::cli
