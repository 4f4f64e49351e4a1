#include "model/data/label_file.h"

#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <system_error>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "model/data/dataset_folder.h"
#include "model/data/dataset_manifest.h"
#include "model/data/quoted_text.h"
#include "model/data/tfrecord.h"
#include "model/files/durable_file.h"
#include "model/files/errno_status.h"

namespace maneuver::data {
namespace {

constexpr char kLabelHeader[] = "recording,target,time,action";
constexpr size_t kMostActionCharacters = 63;
// Times are written with few decimals, so a target may be labelled this long before its first
// state.
constexpr double kWrittenTime = 0.0501;  // seconds

struct Label {
  int64_t line = 0;
  std::string recording;
  int64_t target = 0;
  double time = 0.0;
  std::string action;
};

// Returns the fields of a line; nothing if a quote is not closed or text follows it.
std::optional<std::vector<std::string>> SplitFields(std::string_view line) {
  std::vector<std::string> fields;
  size_t at = 0;
  for (;;) {
    std::string field;
    if (at < line.size() && line[at] == '"') {
      for (++at;; ++at) {
        if (at == line.size()) return std::nullopt;
        if (line[at] == '"' && (at + 1 == line.size() || line[at + 1] != '"')) break;
        if (line[at] == '"') ++at;
        field.push_back(line[at]);
      }
      ++at;
      if (at < line.size() && line[at] != ',') return std::nullopt;
    } else {
      const size_t end = std::min(line.find(',', at), line.size());
      const absl::string_view text(line.data() + at, end - at);
      field = std::string(absl::StripAsciiWhitespace(text));
      at = end;
    }
    fields.push_back(std::move(field));
    if (at == line.size()) return fields;
    ++at;  // the comma
  }
}

bool IsActionName(std::string_view name) {
  const auto belongs = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  };
  return !name.empty() && name.size() <= kMostActionCharacters && name.front() >= 'a' &&
         name.front() <= 'z' && std::ranges::all_of(name, belongs);
}

class LabelFile {
 public:
  explicit LabelFile(const std::set<std::string>& actions) : actions_(actions) {}

  void Read(std::string_view text) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);  // a byte order mark
    bool has_header = false;
    int64_t number = 0;
    while (!text.empty()) {
      ++number;
      const size_t end = std::min(text.find('\n'), text.size());
      std::string_view line = text.substr(0, end);
      text.remove_prefix(std::min(end + 1, text.size()));
      if (line.ends_with('\r')) line.remove_suffix(1);
      if (line.empty()) continue;
      if (!has_header && line != kLabelHeader) {
        Refuse(number, absl::StrCat("the first line must be ", kLabelHeader));
        return;
      }
      if (has_header) ReadLabel(number, line);
      has_header = true;
    }
    if (!has_header) Refuse(1, absl::StrCat("the first line must be ", kLabelHeader));
  }

  // Checks the labels of one recording.
  void Check(const v1::Scenario& recording) {
    const auto labels = by_recording_.find(recording.scenario_id());
    if (labels == by_recording_.end()) return;
    std::unordered_map<int64_t, const v1::Agent*> agents;
    for (const v1::Agent& agent : recording.agents()) agents[agent.id()] = &agent;
    for (const Label& label : labels->second) {
      const auto agent = agents.find(label.target);
      if (agent == agents.end()) {
        Refuse(label.line, absl::StrCat("recording ", QuotedText(label.recording),
                                        " has no target ", label.target));
      } else {
        CheckMoment(label, *agent->second);
      }
    }
    by_recording_.erase(labels);
  }

  CheckedLabels Finish() && {
    for (const auto& [recording, labels] : by_recording_) {
      for (const Label& label : labels) {
        Refuse(label.line,
               absl::StrCat("the dataset has no recording ", QuotedText(label.recording)));
      }
    }
    std::ranges::sort(checked_.problems, {}, &LabelProblem::line);
    if (checked_.problems.size() > kMostLabelProblems) {
      checked_.problems.resize(kMostLabelProblems);
    }
    std::ranges::sort(accepted_, {}, &Label::line);
    for (const Label& label : accepted_) {
      v1::ManeuverAnnotation& annotation = checked_.annotations.emplace_back();
      annotation.set_scenario_id(label.recording);
      annotation.set_agent_id(label.target);
      annotation.set_start_time(label.time);
      annotation.set_end_time(label.time);
      annotation.set_maneuver(label.action);
    }
    return std::move(checked_);
  }

 private:
  void Refuse(int64_t line, std::string what) {
    ++checked_.problem_count;
    checked_.problems.push_back({line, std::move(what)});
  }

  void ReadLabel(int64_t number, std::string_view line) {
    const auto fields = SplitFields(line);
    if (!fields) return Refuse(number, "a quote is not closed, or something follows it");
    if (fields->size() != 4) {
      return Refuse(number, absl::StrCat("has ", fields->size(), " fields, not 4"));
    }
    Label label{.line = number, .recording = (*fields)[0], .action = (*fields)[3]};
    if (label.recording.empty()) return Refuse(number, "names no recording");
    if (!absl::SimpleAtoi((*fields)[1], &label.target)) {
      return Refuse(number, absl::StrCat("target ", QuotedText((*fields)[1]), " is not a number"));
    }
    if (!absl::SimpleAtod((*fields)[2], &label.time) || !std::isfinite(label.time)) {
      return Refuse(number, absl::StrCat("time ", QuotedText((*fields)[2]), " is not a number"));
    }
    if (!IsActionName(label.action)) {
      return Refuse(number, absl::StrCat("action ", QuotedText(label.action),
                                         " must match [a-z][a-z0-9_]* with at most 63 characters"));
    }
    if (!actions_.empty() && !actions_.contains(label.action)) {
      return Refuse(number, absl::StrCat("action ", QuotedText(label.action),
                                         " is none of those that were named"));
    }
    const auto [earlier, is_new] =
        moments_.try_emplace({label.recording, label.target, label.time}, number);
    if (!is_new) {
      return Refuse(number, absl::StrCat("line ", earlier->second,
                                         " labels the same moment of the same target"));
    }
    by_recording_[label.recording].push_back(std::move(label));
  }

  void CheckMoment(const Label& label, const v1::Agent& agent) {
    if (agent.type() != v1::AGENT_TYPE_VEHICLE) {
      return Refuse(label.line, absl::StrCat("target ", label.target, " of recording ",
                                             QuotedText(label.recording), " is not a vehicle"));
    }
    const double first = agent.states().empty() ? 0.0 : agent.states().begin()->time();
    const double last = agent.states().empty() ? -1.0 : agent.states().rbegin()->time();
    if (label.time < first - kWrittenTime || label.time > last + kWrittenTime) {
      return Refuse(label.line, absl::StrCat("target ", label.target, " is not there at ",
                                             label.time, " s, but from ", first, " to ", last));
    }
    accepted_.push_back(label);
  }

  const std::set<std::string>& actions_;
  CheckedLabels checked_;
  // Labels whose recording has not been read yet. A map, so that problems come in a fixed order.
  std::map<std::string, std::vector<Label>> by_recording_;
  std::map<std::tuple<std::string, int64_t, double>, int64_t>
      moments_;  // and the line that labels each
  std::vector<Label> accepted_;
};

// Returns the first of "annotations-00000.tfrecord", ... that is not the name of a shard.
std::string FreeShardName(const v1::Dataset& manifest) {
  for (int number = 0;; ++number) {
    char name[40];
    std::snprintf(name, sizeof name, "annotations-%05d.tfrecord", number);
    if (std::ranges::none_of(manifest.shards(),
                             [&](const v1::Shard& shard) { return shard.file() == name; })) {
      return name;
    }
  }
}

absl::Status FillAnnotated(const std::filesystem::path& folder,
                           const std::vector<v1::ManeuverAnnotation>& annotations,
                           const std::filesystem::path& temporary,
                           const std::function<bool()>& stops, v1::Dataset* manifest) {
  std::error_code error;
  for (const v1::Shard& shard : manifest->shards()) {
    if (stops && stops()) return absl::CancelledError("interrupted");
    std::filesystem::create_hard_link(folder / shard.file(), temporary / shard.file(), error);
    if (error) std::filesystem::copy_file(folder / shard.file(), temporary / shard.file(), error);
    if (error) return files::ErrnoStatus(error.value(), "copy", shard.file());
  }
  v1::Shard added;
  added.set_file(FreeShardName(*manifest));
  added.set_content(v1::SHARD_CONTENT_ANNOTATIONS);
  auto writer = TfRecordWriter::Create(temporary / added.file());
  if (!writer.ok()) return writer.status();
  for (const v1::ManeuverAnnotation& annotation : annotations) {
    const absl::Status status = (*writer)->Append(annotation.SerializeAsString());
    if (!status.ok()) return status;
  }
  if (absl::Status status = (*writer)->Close(); !status.ok()) return status;
  added.set_size_bytes((*writer)->size_bytes());
  added.set_records((*writer)->records());
  added.set_sha256((*writer)->sha256());
  *manifest->add_shards() = std::move(added);
  manifest->clear_name();
  *manifest->mutable_create_time() = google::protobuf::util::TimeUtil::GetCurrentTime();
  return WriteDatasetManifest(temporary, *manifest);
}

}  // namespace

absl::StatusOr<CheckedLabels> CheckLabels(std::string_view text,
                                          const std::filesystem::path& folder,
                                          const std::set<std::string>& actions) {
  LabelFile labels(actions);
  labels.Read(text);
  const absl::Status status =
      ForEachScenario(folder, OnDamage::kStop, [&](v1::Scenario&& recording) {
        labels.Check(recording);
        return true;
      });
  if (!status.ok()) return status;
  return std::move(labels).Finish();
}

absl::StatusOr<v1::Dataset> AnnotateDataset(const std::filesystem::path& folder,
                                            const std::vector<v1::ManeuverAnnotation>& annotations,
                                            const std::filesystem::path& output,
                                            const std::function<bool()>& stops) {
  if (annotations.empty()) return absl::InvalidArgumentError("there are no labels to add");
  auto manifest = ReadDatasetManifest(folder);
  if (!manifest.ok()) return manifest.status();
  auto temporary = files::MakeTemporaryFolderFor(output);
  if (!temporary.ok()) return temporary.status();
  absl::Status status = FillAnnotated(folder, annotations, *temporary, stops, &*manifest);
  if (status.ok()) status = files::PublishFolder(*temporary, output);
  if (!status.ok()) {
    std::error_code ignored;
    std::filesystem::remove_all(*temporary, ignored);
    return status;
  }
  return manifest;
}

}  // namespace maneuver::data
