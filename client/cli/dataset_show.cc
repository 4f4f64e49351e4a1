#include "client/cli/dataset_show.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numbers>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/command.h"
#include "client/cli/json_files.h"
#include "client/cli/resource_names.h"
#include "client/cli/scenario_source.h"
#include "client/cli/settings_argument.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/plot/recordings_plot.h"
#include "model/data/dataset_folder.h"

namespace maneuver::cli {
namespace {

using Counts = google::protobuf::Map<std::string, int64_t>;

constexpr int kBarWidth = 40;

// A folder is a path with a slash; a bare name, or datasets/NAME, is a dataset of the server, also
// where a folder of that name is here.
bool IsFolder(const std::string& source) {
  return source == "." || source == ".." ||
         DatasetResource(source).find('/', sizeof("datasets/") - 1) != std::string::npos;
}

// Returns the source as ListScenarios takes it.
std::string PlaceOf(const std::string& source) {
  return IsFolder(source) ? source : DatasetResource(source);
}

bool HoldsDataset(const std::string& folder) {
  std::error_code error;
  return std::filesystem::exists(std::filesystem::path(folder) / "dataset.json", error);
}

absl::StatusOr<v1::DatasetSummary> Describe(const std::string& source,
                                            v1::DescribeDatasetRequest request,
                                            Environment& environment) {
  if (!IsFolder(source)) {
    request.set_name(DatasetResource(source));
    return environment.server_client().DescribeDataset(request, environment.call_options());
  }
  const auto settings = ResolveExamples(request.examples());
  if (!settings.ok()) return settings.status();
  return data::DescribeDataset(source, settings->model(), settings->examples());
}

std::string CountOf(int64_t count) {
  std::string digits = absl::StrCat(count);
  for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3) {
    digits.insert(static_cast<size_t>(at), " ");
  }
  return digits;
}

std::string ShareOf(int64_t count, int64_t all) {
  return all > 0 ? Share(static_cast<double>(count) / static_cast<double>(all)) : "-";
}

// How often each name; the most frequent first.
std::string CountsText(const std::string& title, const Counts& counts, bool color) {
  if (counts.empty()) return "";
  std::vector<std::pair<std::string, int64_t>> sorted(counts.begin(), counts.end());
  std::ranges::sort(sorted, [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : a.first < b.first;
  });
  Table table({{title}, {"COUNT", Align::kRight}});
  for (const auto& [name, count] : sorted) table.Add({name, CountOf(count)});
  return "\n" + table.Text(color);
}

// A line for each bin, with its share as a bar: the longest is kBarWidth characters.
//   names_of: names the bins of a histogram whose edges are one more than its counts
std::string HistogramText(const std::string& title, const v1::Histogram& histogram,
                          std::vector<std::string> (*names_of)(const v1::Histogram&), bool color) {
  int64_t all = 0;
  int64_t most = 1;
  for (const int64_t count : histogram.counts()) {
    all += count;
    most = std::max(most, count);
  }
  // The bins of a histogram without all its edges have no names.
  if (all == 0 || histogram.edges_size() != histogram.counts_size() + 1) return "";
  const std::vector<std::string> names = names_of(histogram);
  Table table({{title}, {"EXAMPLES", Align::kRight}, {"SHARE", Align::kRight}, {""}});
  for (int i = 0; i < histogram.counts_size(); ++i) {
    const int64_t count = histogram.counts(i);
    const auto length = static_cast<size_t>(
        std::ceil(kBarWidth * static_cast<double>(count) / static_cast<double>(most)));
    table.Add({names[static_cast<size_t>(i)], CountOf(count), ShareOf(count, all),
               std::string(length, '#')});
  }
  return "\n" + table.Text(color);
}

// The bins of speeds: "2.5 to 5 m/s"; the last is open.
std::vector<std::string> SpeedNames(const v1::Histogram& speeds) {
  std::vector<std::string> names;
  for (int i = 0; i < speeds.counts_size(); ++i) {
    names.push_back(i + 1 == speeds.counts_size()
                        ? absl::StrFormat("over %g m/s", speeds.edges(i))
                        : absl::StrFormat("%g to %g m/s", speeds.edges(i), speeds.edges(i + 1)));
  }
  return names;
}

// The bins of turns: "left 30 to 60 deg".
std::vector<std::string> TurnNames(const v1::Histogram& turns) {
  std::vector<std::string> names;
  for (int i = 0; i < turns.counts_size(); ++i) {
    const double from = turns.edges(i) * 180.0 / std::numbers::pi;
    const double to = turns.edges(i + 1) * 180.0 / std::numbers::pi;
    if (from < 0.0 && to > 0.0) {
      names.push_back(absl::StrFormat("straight, within %.0f deg", std::max(-from, to)));
    } else if (to <= 0.0) {
      names.push_back(absl::StrFormat("right, %.0f to %.0f deg", -to, -from));
    } else {
      names.push_back(absl::StrFormat("left, %.0f to %.0f deg", from, to));
    }
  }
  return names;
}

// So many of the recordings, spread evenly over the dataset.
//   place: as for ListScenarios
absl::StatusOr<std::vector<v1::Scenario>> SomeRecordings(const std::string& place, int64_t count,
                                                         Environment& environment) {
  const auto listed = ListScenarios(place, 0, environment);
  if (!listed.ok()) return listed.status();
  const auto all = static_cast<int64_t>(listed->scenarios_size());
  std::vector<v1::Scenario> recordings;
  for (int64_t i = 0; i < std::min(count, all); ++i) {
    const auto index = static_cast<int>(i * all / std::min(count, all));
    auto recording = GetScenario(place, listed->scenarios(index).scenario_id(), environment);
    if (!recording.ok()) return recording.status();
    recordings.push_back(*std::move(recording));
  }
  return recordings;
}

int Plot(const ShowDatasetArguments& arguments, Environment& environment) {
  const std::string place = PlaceOf(arguments.source);
  const auto recordings = SomeRecordings(place, arguments.scenes, environment);
  if (!recordings.ok()) return FailAtSource(place, recordings.status(), environment);
  const auto picture = plot::DrawRecordings(*recordings, {});
  const absl::Status status =
      picture.ok() ? WriteFile(*arguments.plot, *picture) : picture.status();
  if (!status.ok()) return environment.Fail(status);
  environment.err << "the picture is " << *arguments.plot << "\n";
  return kOk;
}

}  // namespace

int64_t SizeBytes(const v1::Dataset& dataset) {
  int64_t bytes = 0;
  for (const v1::Shard& shard : dataset.shards()) bytes += shard.size_bytes();
  return bytes;
}

std::string DescriptionText(const v1::DatasetSummary& summary, bool color) {
  const v1::Dataset& dataset = summary.dataset();
  const int64_t examples = summary.examples();
  const auto vehicles = summary.agents_by_type().find("VEHICLE");
  const v1::MapCoverage& coverage = summary.map_coverage();
  Table table({{"DATASET"}, {dataset.name().empty() ? "(a folder)" : ShortName(dataset.name())}});
  table.Add({"origin", dataset.origin()});
  table.Add({"created", Moment(dataset.create_time())});
  table.Add({"recordings", CountOf(dataset.recordings())});
  table.Add({"driving", Spell(dataset.duration_seconds())});
  table.Add({"size", absl::StrCat(Bytes(SizeBytes(dataset)), " in ",
                                  HowMany(dataset.shards_size(), "file"))});
  table.Add(
      {"examples",
       absl::StrFormat("%s: vehicles, one each %g s, %g s ahead", CountOf(examples),
                       ToSeconds(summary.example_settings().stride()), summary.horizon_seconds())});
  table.Add({"standing", absl::StrCat(CountOf(summary.standing_examples()), " of them (",
                                      ShareOf(summary.standing_examples(), examples), ")")});
  if (vehicles != summary.agents_by_type().end()) {
    table.Add(
        {"never move",
         absl::StrCat(CountOf(summary.standing_vehicles()), " of ", CountOf(vehicles->second),
                      " vehicles (", ShareOf(summary.standing_vehicles(), vehicles->second), ")")});
  }
  table.Add({"map", absl::StrCat(CountOf(coverage.recordings_with_lanes()), " of ",
                                 CountOf(dataset.recordings()), " recordings have lanes, ",
                                 Fixed(coverage.lane_length() / 1e3, 1), " km in all")});
  table.Add({"on a lane", absl::StrCat(CountOf(coverage.examples_on_lanes()), " examples (",
                                       ShareOf(coverage.examples_on_lanes(), examples),
                                       ") are at most 3 m from a centreline")});
  return absl::StrCat(table.Text(color),
                      HistogramText("SPEED", summary.speeds(), SpeedNames, color),
                      HistogramText(absl::StrFormat("TURN IN %g S", summary.horizon_seconds()),
                                    summary.turns(), TurnNames, color),
                      CountsText("AGENTS", summary.agents_by_type(), color),
                      CountsText("EXAMPLES BY TARGET", summary.examples_by_type(), color),
                      CountsText("MAP FEATURES", summary.map_features_by_type(), color),
                      CountsText("MANEUVERS", summary.maneuvers(), color));
}

int ShowDataset(const ShowDatasetArguments& arguments, Environment& environment) {
  v1::DescribeDatasetRequest request;
  for (const std::string& change : arguments.changes) {
    const absl::Status status = SetExampleField(change, request.mutable_examples());
    if (!status.ok()) return environment.Refuse(std::string(status.message()));
  }
  const auto summary = Describe(arguments.source, request, environment);
  if (!summary.ok()) {
    const int failed = FailAtSource(PlaceOf(arguments.source), summary.status(), environment);
    if (!IsFolder(arguments.source) && HoldsDataset(arguments.source)) {
      environment.err << "For the folder of that name: maneuver dataset show ./" << arguments.source
                      << "\n";
    }
    return failed;
  }
  if (environment.json()) {
    environment.PrintJson(*summary);
  } else {
    environment.out << DescriptionText(*summary, environment.color);
  }
  return arguments.plot ? Plot(arguments, environment) : kOk;
}

}  // namespace maneuver::cli
