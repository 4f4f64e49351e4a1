#include "model/tags/tag_datasets.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "model/artifact/model_spec.h"
#include "model/artifact/training_presets.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_index.h"
#include "model/evaluation/action_names.h"
#include "model/machine/ordered_work.h"
#include "model/scene/duration.h"
#include "model/tags/shard_tags.h"
#include "model/tags/tagger.h"

namespace maneuver::tags {
namespace {

namespace fs = std::filesystem;

constexpr size_t kAheadPerThread = 4;   // recordings
constexpr double kMostStride = 3600.0;  // seconds

// A shard of a dataset, and what its tags are called.
struct Source {
  fs::path folder;
  v1::Shard shard;
  TagFile file;
};

// The name of a folder, also if its path ends in a slash or in a dot.
std::string DatasetName(const fs::path& folder) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(folder, error);
  return (error ? folder : whole).filename().string();
}

// What the tags of a shard are called, without the endings of their files.
std::string TagsName(const std::string& dataset, absl::string_view shard) {
  absl::ConsumeSuffix(&shard, ".tfrecord");
  return absl::StrCat(dataset, "-", shard);
}

absl::StatusOr<std::vector<Source>> FindSources(const std::vector<fs::path>& datasets) {
  std::vector<Source> sources;
  std::set<std::string> names;
  std::set<std::string> tags_names;
  for (const fs::path& folder : datasets) {
    const absl::StatusOr<v1::Dataset> manifest = data::ReadDatasetManifest(folder);
    if (!manifest.ok()) {
      return absl::Status(manifest.status().code(),
                          absl::StrCat(folder.string(), ": ", manifest.status().message()));
    }
    const std::string name = DatasetName(folder);
    if (!names.insert(name).second) {
      return absl::InvalidArgumentError(absl::StrCat("two datasets are called ", name,
                                                     "; tag them into two folders, or rename one"));
    }
    for (const v1::Shard& shard : manifest->shards()) {
      if (shard.content() != v1::SHARD_CONTENT_SCENARIOS) continue;
      Source& source = sources.emplace_back(Source{folder, shard, {}});
      source.file.set_name(TagsName(name, shard.file()));
      if (!tags_names.insert(source.file.name()).second) {
        return absl::InvalidArgumentError(absl::StrCat("the tags of two shards would be called ",
                                                       source.file.name(),
                                                       "; rename a dataset or a shard"));
      }
      source.file.set_dataset(name);
      source.file.set_shard(shard.file());
      source.file.set_shard_sha256(shard.sha256());
    }
  }
  return sources;
}

TagSchema MakeSchema(const inference::ActionModel& model, const v1::ExampleSettings& examples,
                     const TaggingOptions& options, const std::vector<Source>& sources) {
  TagSchema schema;
  schema.set_format_version(kTagFormatVersion);
  schema.set_merged(options.merged);
  schema.set_model_sha256(model.manifest().weights_sha256());
  schema.set_precision(std::string(model.precision()));
  for (const std::string& name : evaluation::DisplayNames(model.manifest())) {
    schema.add_action_names(name);
  }
  schema.set_stride(scene::ToSeconds(examples.stride()));
  schema.set_horizon(artifact::WaypointTimes(model.spec().trajectory()).back());
  schema.set_max_speed(examples.max_speed());
  for (TagColumn& column : CsvColumns()) *schema.add_columns() = std::move(column);
  for (const Source& source : sources) *schema.add_files() = source.file;
  return schema;
}

// One recording's rows, or why there are none.
using TaggedRecording = absl::StatusOr<std::vector<CsvRow>>;

int64_t WindowsOf(const std::vector<CsvRow>& rows) {
  return std::accumulate(rows.begin(), rows.end(), int64_t{0}, [](int64_t sum, const CsvRow& row) {
    return sum + row.row[Column::kWindows];
  });
}

// Tags shards one after the other. Its threads' taggers serve all of them.
class Tagging {
 public:
  Tagging(const std::shared_ptr<const inference::ActionModel>& model,
          const v1::ExampleSettings& examples, const Schema& schema, const TaggingOptions& options)
      : schema_(schema), options_(options) {
    for (int i = 0; i < std::max(1, options.threads); ++i) {
      taggers_.push_back(std::make_unique<Tagger>(model, TaggerOptions{examples, options.merged}));
    }
  }

  absl::StatusOr<TaggingSummary> Run(const std::vector<Source>& sources) {
    std::vector<const Source*> waiting;
    for (size_t i = 0; i < sources.size(); ++i) {
      if (static_cast<int64_t>(i) % options_.parts != options_.part) continue;
      if (IsTagged(options_.output, schema_, sources[i].file)) {
        ++summary_.shards_before;
        ++progress_.shards_before;
      } else {
        waiting.push_back(&sources[i]);
        progress_.all_recordings += sources[i].shard.records();
      }
    }
    for (const Source* source : waiting) {
      const absl::StatusOr<data::RecordingIndex> index =
          data::RecordingIndex::OpenShard(source->folder, source->shard);
      const absl::Status unreadable = index.ok() ? absl::OkStatus() : absl::Status(index.status());
      absl::Status status = unreadable;
      if (index.ok()) status = TagShard(*index, source->file);
      if (status.ok()) continue;
      if (!unreadable.ok() || absl::IsDataLoss(status)) {
        summary_.failures.push_back(absl::Status(
            status.code(), absl::StrCat(source->file.dataset(), ": ", status.message())));
        continue;
      }
      return status;
    }
    return summary_;
  }

 private:
  absl::Status TagShard(const data::RecordingIndex& index, const TagFile& file) {
    auto writer = ShardTagsWriter::Create(options_.output, schema_, file);
    if (!writer.ok()) return writer.status();
    std::vector<size_t> order(index.entries().size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::sort(
        order, {}, [&](size_t i) -> const std::string& { return index.entries()[i].scenario_id; });
    machine::OrderedWork<TaggedRecording> work(order.size(), kAheadPerThread * taggers_.size());
    for (const std::unique_ptr<Tagger>& tagger : taggers_) {
      work.Start([&, mine = tagger.get()] {
        while (const std::optional<size_t> item = work.Claim()) {
          const absl::StatusOr<v1::Scenario> recording = index.Read(order[*item]);
          work.Put(*item, recording.ok() ? TaggedRecording(mine->Tag(*recording))
                                         : TaggedRecording(recording.status()));
        }
      });
    }
    TaggingSummary added;
    absl::Status status;
    for (const size_t entry : order) {
      const TaggedRecording rows = *work.Take();
      status = rows.status();
      if (status.ok()) status = (*writer)->Add(index.entries()[entry].scenario_id, *rows);
      if (!status.ok()) break;
      const int64_t windows = WindowsOf(*rows);
      ++added.recordings;
      added.windows += windows;
      added.rows += static_cast<int64_t>(rows->size());
      ++progress_.recordings;
      progress_.windows += windows;
      if (options_.progress && !options_.progress(progress_)) {
        status =
            absl::CancelledError("tagging was stopped; run the same command again to continue");
        break;
      }
    }
    if (status.ok()) status = (*writer)->Commit();
    if (!status.ok()) return status;
    ++summary_.shards;
    summary_.recordings += added.recordings;
    summary_.windows += added.windows;
    summary_.rows += added.rows;
    ++progress_.shards;
    for (const fs::path& each :
         {CsvFileOf(options_.output, file), TagsFileOf(options_.output, file)}) {
      std::error_code error;
      const uintmax_t size = fs::file_size(each, error);
      if (!error) progress_.bytes += static_cast<int64_t>(size);
    }
    if (options_.progress && !options_.progress(progress_)) {
      return absl::CancelledError("tagging was stopped; run the same command again to continue");
    }
    return absl::OkStatus();
  }

  const Schema& schema_;
  const TaggingOptions& options_;
  std::vector<std::unique_ptr<Tagger>> taggers_;  // one per thread
  TaggingProgress progress_;
  TaggingSummary summary_;
};

}  // namespace

v1::ExampleSettings TaggingExamples(const v1::ModelManifest& manifest,
                                    std::optional<double> stride) {
  v1::TrainingSettings settings = manifest.provenance().settings();
  *settings.mutable_model() = manifest.spec();
  v1::ExampleSettings examples = artifact::ResolveTrainingSettings(settings).examples();
  examples.set_keep_standing(1.0);
  if (stride) {
    const auto nanos = static_cast<int64_t>(std::llround(*stride * 1e9));
    examples.mutable_stride()->set_seconds(nanos / 1'000'000'000);
    examples.mutable_stride()->set_nanos(static_cast<int32_t>(nanos % 1'000'000'000));
  }
  return examples;
}

absl::StatusOr<TaggingSummary> TagDatasets(std::shared_ptr<const inference::ActionModel> model,
                                           const TaggingOptions& options) {
  if (options.parts < 1 || options.part < 0 || options.part >= options.parts) {
    return absl::InvalidArgumentError(absl::StrCat("there is no part ", options.part, " of ",
                                                   options.parts, "; parts are counted from 0"));
  }
  if (options.stride &&
      !(*options.stride >= artifact::kLeastStride && *options.stride <= kMostStride)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "stride must lie within ", artifact::kLeastStride, " and ", kMostStride, " seconds"));
  }
  const absl::StatusOr<std::vector<Source>> sources = FindSources(options.datasets);
  if (!sources.ok()) return sources.status();
  const v1::ExampleSettings examples = TaggingExamples(model->manifest(), options.stride);
  const absl::StatusOr<Schema> schema =
      PrepareTagFolder(options.output, MakeSchema(*model, examples, options, *sources));
  if (!schema.ok()) return schema.status();
  return Tagging(model, examples, *schema, options).Run(*sources);
}

}  // namespace maneuver::tags
