#include "client/report/report_json.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/time/time.h"
#include "client/report/scene_json.h"
#include "model/evaluation/metric_table.h"
#include "model/evaluation/rival_table.h"

namespace maneuver::report {
namespace {

using nlohmann::json;

constexpr int kMostWaypoints = 26;  // more are not seen at the size of the drawings

// What a script cannot be ended or changed by.
std::string SafeInScript(const json& value) {
  return absl::StrReplaceAll(
      value.dump(-1, ' ', /*ensure_ascii=*/false, json::error_handler_t::replace),
      {{"<", "\\u003c"},
       {">", "\\u003e"},
       {"&", "\\u0026"},
       {"\xe2\x80\xa8", "\\u2028"},
       {"\xe2\x80\xa9", "\\u2029"}});
}

json MessageJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;  // as --set takes them
  std::string text;
  // Fails only for an Any of a type that is not linked in; the contract has none.
  (void)google::protobuf::util::MessageToJsonString(message, &text, options);
  json parsed = json::parse(text, nullptr, /*allow_exceptions=*/false);
  return parsed.is_discarded() ? json::object() : parsed;
}

std::string TimeText(const google::protobuf::Timestamp& time) {
  if (time.seconds() == 0) return "";
  return absl::FormatTime("%Y-%m-%d %H:%M:%S UTC", absl::FromUnixSeconds(time.seconds()),
                          absl::UTCTimeZone());
}

// Which of `count` waypoints are drawn: evenly spread, the last one among them.
std::vector<int> DrawnWaypoints(int count) {
  const int step = (count + kMostWaypoints - 1) / kMostWaypoints;
  std::vector<int> drawn;
  for (int t = count - 1; t >= 0; t -= std::max(step, 1)) drawn.push_back(t);
  std::ranges::reverse(drawn);
  return drawn;
}

std::string NameOf(const v1::Action& action) {
  if (!action.display_name().empty()) return action.display_name();
  if (!action.label().empty()) return action.label();
  if (!action.derived_name().empty()) return action.derived_name();
  return absl::StrCat("action ", action.action_id());
}

json UseJson(const v1::ActionUse& use) {
  return {{"probability", Rounded(use.probability(), 4)},
          {"largest", Rounded(use.largest_probability(), 4)},
          {"examples", use.examples()},
          {"kinematic", use.kinematic_class()},
          {"kinematicShare", Rounded(use.class_share(), 3)},
          {"relative", use.relative_class()},
          {"relativeShare", Rounded(use.relative_class_share(), 3)}};
}

// One action over all speeds that it is drawn at.
json ActionJson(const ReportData& data, int index, const std::vector<int>& waypoints) {
  const v1::Action& action = data.action_sets.front().actions(index);
  json shapes = json::array();
  for (const v1::ActionSet& set : data.action_sets) {
    if (index >= set.actions_size()) continue;
    const v1::ActionDistribution& distribution = set.actions(index).distribution();
    json shape = DistributionJson(distribution, waypoints);
    json& sigma = shape["sigma"] = json::array();
    for (const v1::Trajectory& trajectory : distribution.sigma_trajectories()) {
      sigma.push_back(PointsJson(trajectory, waypoints));
    }
    shapes.push_back(std::move(shape));
  }
  json entry = {{"id", action.action_id()},        {"name", NameOf(action)},
                {"label", action.label()},         {"usage", Rounded(action.usage(), 4)},
                {"effective", action.effective()}, {"shapes", std::move(shapes)}};
  if (data.evaluation && action.action_id() < data.evaluation->action_uses_size()) {
    entry["use"] = UseJson(data.evaluation->action_uses(action.action_id()));
  }
  return entry;
}

json ActionsJson(const ReportData& data, const std::vector<int>& waypoints) {
  json actions = json::array();
  json speeds = json::array();
  for (const v1::ActionSet& set : data.action_sets) {
    if (set.has_speed()) speeds.push_back(set.speed());
  }
  for (int i = 0; i < data.action_sets.front().actions_size(); ++i) {
    actions.push_back(ActionJson(data, i, waypoints));
  }
  return {{"speeds", std::move(speeds)}, {"list", std::move(actions)}};
}

const char* BetterSide(evaluation::Better better) {
  switch (better) {
    case evaluation::Better::kLower:
      return "lower";
    case evaluation::Better::kHigher:
      return "higher";
    case evaluation::Better::kNearer:
      return "nearer";
    default:
      return "";
  }
}

// Metrics in the order in which they are listed: {"name", "value", "unit", "better", "ideal",
// "ofModel"}. Those that no table knows come last.
template <typename Metrics>
json MetricsJson(const Metrics& metrics) {
  std::vector<std::pair<int, json>> ranked;
  const std::map<std::string, double> by_name(metrics.begin(), metrics.end());
  for (const auto& [name, value] : by_name) {
    const auto info = evaluation::FindMetric(name);
    json entry = {{"name", name}, {"value", Rounded(value, 5)}};
    if (info) {
      entry["unit"] = std::string(info->unit);
      entry["better"] = BetterSide(info->better);
      entry["ofModel"] = info->of_model;
      if (info->better == evaluation::Better::kNearer) entry["ideal"] = Rounded(info->ideal, 4);
    }
    ranked.emplace_back(info ? info->rank : INT32_MAX, std::move(entry));
  }
  std::ranges::stable_sort(ranked, {}, [](const auto& entry) { return entry.first; });
  json list = json::array();
  for (auto& [rank, entry] : ranked) list.push_back(std::move(entry));
  return list;
}

template <typename Figures>
json FiguresJson(const Figures& figures, int digits) {
  json object = json::object();
  for (const auto& [name, value] : figures) object[name] = Rounded(value, digits);
  return object;
}

const char* Verdict(v1::RivalVerdict verdict) {
  switch (verdict) {
    case v1::RIVAL_VERDICT_AHEAD:
      return "ahead";
    case v1::RIVAL_VERDICT_BEHIND:
      return "behind";
    default:
      return "undecided";
  }
}

json RivalsJson(const v1::RivalStandings& standings) {
  json parts = json::array();
  for (const v1::RivalStanding& part : standings.parts()) {
    json comparisons = json::array();
    for (const v1::RivalComparison& comparison : part.comparisons()) {
      comparisons.push_back({{"metric", comparison.metric()},
                             {"rival", comparison.rival()},
                             {"value", Rounded(comparison.difference().value(), 4)},
                             {"lower", Rounded(comparison.difference().lower(), 4)},
                             {"upper", Rounded(comparison.difference().upper(), 4)},
                             {"verdict", Verdict(comparison.verdict())}});
    }
    parts.push_back({{"dimension", part.dimension()},
                     {"name", part.name()},
                     {"examples", part.examples()},
                     {"groups", part.groups()},
                     {"comparisons", std::move(comparisons)}});
  }
  json titles = json::object();
  for (const evaluation::Rival& rival : evaluation::kRivals) {
    titles[std::string(rival.name)] = std::string(rival.title);
  }
  return {{"recordings", standings.recordings()},
          {"groups", standings.groups()},
          {"titles", std::move(titles)},
          {"parts", std::move(parts)}};
}

json EvaluationJson(const v1::EvaluationReport& report) {
  json bins = json::array();
  for (const v1::ReliabilityBin& bin : report.reliability()) {
    bins.push_back({{"lower", Rounded(bin.lower(), 3)},
                    {"upper", Rounded(bin.upper(), 3)},
                    {"examples", bin.examples()},
                    {"confidence", Rounded(bin.mean_confidence(), 4)},
                    {"responsibility", Rounded(bin.mean_responsibility(), 4)}});
  }
  json strata = json::array();
  for (const v1::EvaluationStratum& stratum : report.strata()) {
    if (stratum.examples() == 0) continue;
    strata.push_back({{"dimension", stratum.dimension()},
                      {"name", stratum.name()},
                      {"examples", stratum.examples()},
                      {"metrics", FiguresJson(stratum.metrics(), 4)}});
  }
  return {{"dataset", report.dataset()},
          {"examples", report.examples()},
          {"time", TimeText(report.create_time())},
          {"metrics", MetricsJson(report.metrics())},
          {"reliability", std::move(bins)},
          {"strata", std::move(strata)},
          {"rivals", RivalsJson(report.rivals())}};
}

// {"name", "epochs": [..], "terms": [{"name", "training": [..], "heldOut": [..]}]}; a term that an
// epoch does not have is null there.
json LearningJson(const LearningPhase& phase) {
  json epochs = json::array();
  std::map<std::string, json> terms;
  const auto add = [&](const auto& figures, const char* examples, size_t epoch) {
    for (const auto& [name, value] : figures) {
      json& curve = terms[name][examples];
      while (curve.size() < epoch) curve.push_back(nullptr);
      curve.push_back(Rounded(value, 5));
    }
  };
  for (size_t i = 0; i < phase.epochs.size(); ++i) {
    const v1::EpochReport& epoch = phase.epochs[i].epoch_report();
    epochs.push_back(phase.epochs[i].epoch());
    add(epoch.training(), "training", i);
    add(epoch.validation(), "heldOut", i);
    add(MixtureFigures(epoch), "mixture", i);
  }
  json list = json::array();
  for (auto& [name, curves] : terms) {
    curves["name"] = name;
    list.push_back(std::move(curves));
  }
  return {{"name", phase.name}, {"epochs", std::move(epochs)}, {"terms", std::move(list)}};
}

json ModelJson(const v1::ModelVersion& version) {
  const v1::ModelManifest& manifest = version.manifest();
  const v1::Provenance& provenance = manifest.provenance();
  return {{"name", version.name()},
          {"time", TimeText(version.create_time())},
          {"trainTime", TimeText(provenance.train_time())},
          {"aliases", std::vector<std::string>(version.aliases().begin(), version.aliases().end())},
          {"datasets",
           std::vector<std::string>(provenance.datasets().begin(), provenance.datasets().end())},
          {"startFrom", provenance.start_from()},
          {"trainer", provenance.trainer_version()},
          {"trainingExamples", provenance.training_examples()},
          {"heldOutExamples", provenance.validation_examples()},
          {"weightsSha256", manifest.weights_sha256()},
          {"parameters", version.cost().parameters()},
          {"settings", MessageJson(provenance.settings())},
          {"spec", MessageJson(manifest.spec())},
          {"heldOut", MetricsJson(manifest.metrics())}};
}

json JobJson(const v1::Job& job) {
  json entry = {{"name", job.name()},
                {"created", TimeText(job.create_time())},
                {"started", TimeText(job.start_time())},
                {"ended", TimeText(job.end_time())},
                {"processes", job.attempts().started()},
                {"error", job.error().message()}};
  if (job.has_promotion_decision()) {
    entry["promoted"] = job.promotion_decision().promoted();
    entry["promotionReason"] = job.promotion_decision().reason();
  }
  return entry;
}

json OthersJson(const std::vector<v1::EvaluationReport>& reports) {
  json others = json::array();
  for (const v1::EvaluationReport& report : reports) {
    others.push_back({{"version", report.model_version()},
                      {"time", TimeText(report.create_time())},
                      {"metrics", FiguresJson(report.metrics(), 5)}});
  }
  return others;
}

// The times of the waypoints that are drawn, and which those are.
std::vector<double> WaypointTimes(const ReportData& data) {
  if (data.action_sets.empty()) return {};
  const auto& times = data.action_sets.front().waypoint_times();
  return {times.begin(), times.end()};
}

}  // namespace

std::string ReportJson(const ReportData& data, size_t most_bytes) {
  const std::vector<double> all_times = WaypointTimes(data);
  const std::vector<int> waypoints = DrawnWaypoints(static_cast<int>(all_times.size()));
  json times = json::array();
  for (const int t : waypoints) times.push_back(Rounded(all_times[static_cast<size_t>(t)], 3));
  json page = {{"title", data.title},
               {"made", data.made},
               {"program", data.program},
               {"times", std::move(times)},
               {"scenesFrom", data.scenes_from},
               {"others", OthersJson(data.others)}};
  if (data.version) page["model"] = ModelJson(*data.version);
  if (data.job) page["job"] = JobJson(*data.job);
  if (!data.action_sets.empty()) page["actions"] = ActionsJson(data, waypoints);
  if (data.evaluation) {
    page["evaluation"] = EvaluationJson(*data.evaluation);
    page["evaluation"]["datasetSha256"] = data.evaluation->dataset_sha256();
    page["evaluation"]["settings"] = MessageJson(data.evaluation->example_settings());
  }
  json& learning = page["learning"] = json::array();
  for (const LearningPhase& phase : data.learning) learning.push_back(LearningJson(phase));
  json& missing = page["missing"] = json::object();
  for (const auto& [part, what] : data.missing) {
    missing[part] = {{"reason", what.reason}, {"command", what.command}};
  }
  // Scenes are most of the page.
  size_t bytes = page.dump(-1, ' ', false, json::error_handler_t::replace).size();
  json& scenes = page["scenes"] = json::array();
  for (const Scene& scene : data.scenes) {
    json entry = SceneJson(scene, waypoints, all_times.empty() ? 0.0 : all_times.back());
    bytes += entry.dump(-1, ' ', false, json::error_handler_t::replace).size() + 1;
    if (bytes > most_bytes) break;
    scenes.push_back(std::move(entry));
  }
  page["scenesLeftOut"] = data.scenes.size() - scenes.size();
  return SafeInScript(page);
}

}  // namespace maneuver::report
