// maneuver find: which targets of tagged recordings did this?

#include <google/protobuf/struct.pb.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <ostream>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/commands.h"
#include "client/cli/found_scenes.h"
#include "client/cli/found_shares.h"
#include "client/cli/interrupt.h"
#include "client/cli/json_files.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "client/plot/recordings_plot.h"
#include "client/plot/share_plot.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_split.h"
#include "model/machine/usable_cores.h"
#include "model/tags/tag_query.h"

namespace maneuver::cli {
namespace {

namespace fs = std::filesystem;
using google::protobuf::Struct;
using tags::Column;

constexpr int kMostPanels = 16;
constexpr int64_t kMostMatches = 1'000'000;
constexpr int64_t kMatchesShown = 20;  // without --limit
constexpr double kWithin = 3.0;        // seconds, without --within
constexpr int64_t kCandidates = 20;    // for each scene of a dataset without near-duplicates

struct FindArguments {
  std::vector<std::string> folders;
  std::vector<std::string> actions;
  std::vector<std::string> scenes;
  std::vector<std::string> conditions;
  std::optional<double> min_probability;
  std::string speed;
  std::string near;
  std::string surprise;
  std::vector<std::string> followed_by;
  std::vector<std::string> meanwhile;
  std::vector<std::string> answered_by;
  std::optional<double> within;
  std::optional<double> distance;
  std::string side = "any";
  std::string by;
  std::string per;
  std::vector<std::string> against;
  std::optional<int64_t> limit;
  bool distinct = false;
  std::vector<std::string> datasets;
  std::optional<std::string> plot;
  std::string extract;
  std::string as_dataset;
  int64_t threads = 0;
};

absl::Status Unreadable(const std::string& option, const std::string& text,
                        const std::string& example) {
  return absl::InvalidArgumentError(
      absl::StrCat(option, " ", text, ": give it as in ", option, " ", example));
}

// Parses numbers between commas.
std::optional<std::vector<double>> Numbers(const std::string& text) {
  std::vector<double> numbers;
  for (const std::string& part : std::vector<std::string>(absl::StrSplit(text, ','))) {
    double number = 0.0;
    if (!absl::SimpleAtod(part, &number) || !std::isfinite(number)) return std::nullopt;
    numbers.push_back(number);
  }
  return numbers;
}

// Adds the condition "5..12", "5.." or "..12".
absl::Status AddSpeed(const std::string& text, tags::TagQuery* query) {
  const std::pair<std::string, std::string> ends = absl::StrSplit(text, absl::MaxSplits("..", 1));
  double least = -HUGE_VAL;
  double most = HUGE_VAL;
  const bool readable = text.find("..") != std::string::npos &&
                        (ends.first.empty() || absl::SimpleAtod(ends.first, &least)) &&
                        (ends.second.empty() || absl::SimpleAtod(ends.second, &most));
  if (!readable || !(least <= most)) return Unreadable("--speed", text, "5..12");
  query->conditions.push_back(tags::Between(Column::kSpeed, least, most));
  return absl::OkStatus();
}

// "top:50" or a number of nats.
absl::Status AddSurprise(const std::string& text, FindArguments* arguments, tags::TagQuery* query) {
  query->most_surprising = true;
  if (absl::StartsWith(text, "top:")) {
    if (arguments->limit) {
      return absl::InvalidArgumentError("--limit and --surprise top:N: give one of them");
    }
    int64_t& limit = arguments->limit.emplace();
    const bool readable =
        absl::SimpleAtoi(text.substr(4), &limit) && limit > 0 && limit <= kMostMatches;
    return readable ? absl::OkStatus() : Unreadable("--surprise", text, "top:50");
  }
  double least = 0.0;
  if (!absl::SimpleAtod(text, &least) || std::isnan(least))
    return Unreadable("--surprise", text, "top:50");
  query->conditions.push_back(tags::Between(Column::kSurprise, least, HUGE_VAL));
  return absl::OkStatus();
}

absl::Status AddOther(const FindArguments& arguments, tags::TagQuery* query) {
  const bool then = !arguments.answered_by.empty();
  if (arguments.within && !then && arguments.followed_by.empty()) {
    return absl::InvalidArgumentError("--within needs --followed-by or --answered-by");
  }
  if (then && !arguments.meanwhile.empty()) {
    return absl::InvalidArgumentError("--with and --answered-by: give one of them");
  }
  if (!then && arguments.meanwhile.empty()) {
    if (!arguments.distance && arguments.side == "any") return absl::OkStatus();
    return absl::InvalidArgumentError("--distance and --side need --with or --answered-by");
  }
  tags::OtherTarget& other = query->other.emplace();
  other.actions = then ? arguments.answered_by : arguments.meanwhile;
  other.when = then ? tags::OtherTarget::When::kThen : tags::OtherTarget::When::kMeanwhile;
  other.within = arguments.within.value_or(kWithin);
  other.distance = arguments.distance.value_or(HUGE_VAL);
  other.side = arguments.side == "ahead"    ? tags::OtherTarget::Side::kAhead
               : arguments.side == "behind" ? tags::OtherTarget::Side::kBehind
                                            : tags::OtherTarget::Side::kAny;
  return absl::OkStatus();
}

constexpr std::pair<const char*, tags::Grouping> kGroupings[] = {
    {"action", tags::Grouping::kAction},  {"class", tags::Grouping::kClass},
    {"speed", tags::Grouping::kSpeed},    {"place", tags::Grouping::kPlace},
    {"hour", tags::Grouping::kHour},      {"scene", tags::Grouping::kScene},
    {"dataset", tags::Grouping::kDataset}};

absl::StatusOr<tags::TagQuery> ReadQuery(FindArguments* arguments) {
  tags::TagQuery query;
  query.actions = arguments->actions;
  query.scenes = arguments->scenes;
  query.threads =
      arguments->threads > 0 ? static_cast<int>(arguments->threads) : machine::UsableCores();
  if (arguments->min_probability) {
    query.conditions.push_back(
        tags::Between(Column::kProbability, *arguments->min_probability, HUGE_VAL));
  }
  absl::Status status;
  if (!arguments->speed.empty()) status = AddSpeed(arguments->speed, &query);
  if (status.ok() && !arguments->surprise.empty()) {
    status = AddSurprise(arguments->surprise, arguments, &query);
  }
  if (status.ok()) status = AddOther(*arguments, &query);
  if (!status.ok()) return status;
  for (const std::string& text : arguments->conditions) {
    const absl::StatusOr<tags::Condition> condition = tags::ParseCondition(text);
    if (!condition.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("--where ", condition.status().message()));
    }
    query.conditions.push_back(*condition);
  }
  if (!arguments->near.empty()) {
    const auto numbers = Numbers(arguments->near);
    if (!numbers || numbers->size() != 3 || (*numbers)[2] < 0.0) {
      return Unreadable("--near", arguments->near, "120,-40,50");
    }
    query.near = tags::NearPlace{(*numbers)[0], (*numbers)[1], (*numbers)[2]};
  }
  if (!arguments->followed_by.empty()) {
    query.followed_by =
        tags::FollowedBy{arguments->followed_by, arguments->within.value_or(kWithin)};
  }
  for (const auto& [name, grouping] : kGroupings) {
    if (arguments->by == name) query.grouping = grouping;
    if (arguments->per == name) query.parts = grouping;
  }
  arguments->distinct |= !arguments->as_dataset.empty();
  const bool counts = query.grouping != tags::Grouping::kNone;
  if (!arguments->against.empty() && !counts) {
    return absl::InvalidArgumentError("--against needs --by: what is to be compared?");
  }
  if (!arguments->per.empty() && !counts) {
    return absl::InvalidArgumentError("--per needs --by: what is to be counted?");
  }
  if (counts && (arguments->distinct || arguments->surprise.starts_with("top:"))) {
    return absl::InvalidArgumentError(
        "--by counts all rows: give it no --distinct, --as-dataset or --surprise top:N");
  }
  query.errors = !arguments->against.empty() || (counts && arguments->plot);
  query.limit = static_cast<size_t>(arguments->limit.value_or(kMatchesShown) *
                                    (arguments->distinct ? kCandidates : 1));
  return query;
}

// The answer of one command.
class Finding {
 public:
  Finding(const FindArguments& arguments, const tags::TagSet& set, const tags::Found& found,
          const tags::Found* against, std::vector<tags::Match> matches, bool at_peak,
          Environment& environment)
      : arguments_(arguments),
        set_(set),
        found_(found),
        against_(against),
        matches_(std::move(matches)),
        at_peak_(at_peak),
        environment_(environment),
        scenes_(set, arguments.datasets) {}

  int Answer() {
    if (environment_.json()) {
      environment_.PrintJson(Json());
    } else {
      environment_.out << (arguments_.by.empty() ? MatchesText() : CountsText());
      environment_.err << HowMany(found_.all.rows, "row") << ", "
                       << HowMany(found_.all.windows, "window");
      if (arguments_.by.empty() && static_cast<int64_t>(matches_.size()) < found_.all.rows) {
        environment_.err << "; " << matches_.size() << " shown";
      }
      environment_.err << "\n";
    }
    absl::Status status;
    if (arguments_.plot) status = arguments_.by.empty() ? Plot() : PlotShares();
    if (status.ok() && !arguments_.extract.empty()) status = Extract();
    if (status.ok() && !arguments_.as_dataset.empty()) status = WriteDataset();
    return status.ok() ? kOk : environment_.Fail(status);
  }

 private:
  const tags::TaggedShard& ShardOf(const tags::Match& match) const {
    return set_.shards[match.shard];
  }
  std::string Text(const tags::Match& match, size_t row, Column column) const {
    const int64_t value = ShardOf(match).tags->Value(column, row);
    if (column == Column::kClass) return tags::ClassName(value);
    return tags::DecimalText(value, tags::SpecOf(column).decimals);
  }
  const std::string& ActionName(const tags::Match& match, size_t row) const {
    const tags::TaggedShard& shard = ShardOf(match);
    return shard.ActionName(shard.tags->Value(Column::kAction, row));
  }

  std::string MatchesText() const {
    const bool follows = !arguments_.followed_by.empty();
    const bool meets = !arguments_.meanwhile.empty() || !arguments_.answered_by.empty();
    std::vector<Column> numbers = {Column::kFrom,     Column::kTo,    Column::kProbability,
                                   Column::kSurprise, Column::kSpeed, Column::kX,
                                   Column::kY};
    std::vector<cli::Column> columns = {
        {"SCENARIO"}, {"TARGET", Align::kRight}, {"CLASS"}, {"ACTION"}};
    for (const char* title :
         {"FROM, s", "TO, s", "p(y|s)", "-ln p", "SPEED, m/s", "X, m", "Y, m"}) {
      columns.push_back({title, Align::kRight});
    }
    if (follows) columns.insert(columns.end(), {{"FOLLOWED BY"}, {"AT, s", Align::kRight}});
    if (meets) columns.insert(columns.end(), {{"OTHER", Align::kRight}, {"ITS ACTION"}});
    Table table(columns);
    for (const tags::Match& match : matches_) {
      std::vector<std::string> cells = {
          ShardOf(match).Scene(match.row), Text(match, match.row, Column::kTarget),
          Text(match, match.row, Column::kClass), ActionName(match, match.row)};
      for (const Column column : numbers) cells.push_back(Text(match, match.row, column));
      if (follows) {
        cells.push_back(ActionName(match, *match.following));
        cells.push_back(Text(match, *match.following, Column::kFrom));
      }
      if (meets) {
        cells.push_back(Text(match, *match.other, Column::kTarget));
        cells.push_back(ActionName(match, *match.other));
      }
      table.Add(std::move(cells));
    }
    return matches_.empty() ? "" : table.Text(environment_.color);
  }

  // Of all rows; with --per, of each part.
  std::string CountsText() const {
    const auto text = [&](const tags::Statistics& these, const tags::Statistics* those) {
      return those != nullptr ? ComparisonText(these, *those) : GroupsText(these);
    };
    if (arguments_.per.empty()) return text(found_, against_);
    std::string all;
    for (const std::string& part : PartNames(found_, against_)) {
      absl::StrAppend(
          &all, all.empty() ? "" : "\n", arguments_.per, " ", part, "\n",
          text(PartOf(found_, part), against_ == nullptr ? nullptr : &PartOf(*against_, part)));
    }
    return all;
  }

  std::string GroupsText(const tags::Statistics& counted) const {
    Table table({{absl::AsciiStrToUpper(arguments_.by)},
                 {"ROWS", Align::kRight},
                 {"WINDOWS", Align::kRight},
                 {"SHARE", Align::kRight},
                 {"p(y|s)", Align::kRight},
                 {"-ln p", Align::kRight},
                 {"ADE, m", Align::kRight}});
    std::vector<std::pair<std::string, tags::Group>> groups(counted.groups.begin(),
                                                            counted.groups.end());
    std::ranges::stable_sort(groups, std::greater(),
                             [](const auto& group) { return group.second.windows; });
    for (const auto& [name, group] : groups) {
      table.Add({name, absl::StrCat(group.rows), absl::StrCat(group.windows), Share(group.share),
                 Fixed(group.probability, 3), Fixed(group.surprise, 2), Fixed(group.ade, 2)});
    }
    return groups.empty() ? "" : table.Text(environment_.color);
  }

  // Those of both answers.
  static std::set<std::string> ComparedGroups(const tags::Statistics& these,
                                              const tags::Statistics& those) {
    std::set<std::string> names;
    for (const auto& [name, group] : these.groups) names.insert(name);
    for (const auto& [name, group] : those.groups) names.insert(name);
    return names;
  }

  static double ShareIn(const tags::Statistics& found, const std::string& name) {
    const auto group = found.groups.find(name);
    return group == found.groups.end() ? 0.0 : group->second.share;
  }

  // The largest changes first.
  std::string ComparisonText(const tags::Statistics& these, const tags::Statistics& those) const {
    std::vector<std::pair<std::string, tags::Change>> changes;
    for (const std::string& name : ComparedGroups(these, those)) {
      changes.emplace_back(name, tags::Compare(these, those, name));
    }
    std::ranges::stable_sort(changes, std::greater(),
                             [](const auto& change) { return std::abs(change.second.difference); });
    Table table({{absl::AsciiStrToUpper(arguments_.by)},
                 {"SHARE", Align::kRight},
                 {"AGAINST", Align::kRight},
                 {"CHANGE", Align::kRight},
                 {"95 %, FROM", Align::kRight},
                 {"TO", Align::kRight},
                 {""}});
    for (const auto& [name, change] : changes) {
      const bool certain = change.low > 0.0 || change.high < 0.0;
      table.Add({name, Share(ShareIn(these, name)), Share(ShareIn(those, name)),
                 Share(change.difference), Share(change.low), Share(change.high),
                 certain ? "changed" : ""});
    }
    return changes.empty() ? "" : table.Text(environment_.color);
  }

  static void Set(const std::string& name, double number, Struct* object) {
    (*object->mutable_fields())[name].set_number_value(number);
  }
  static void Set(const std::string& name, const std::string& text, Struct* object) {
    (*object->mutable_fields())[name].set_string_value(text);
  }
  static Struct GroupJson(const tags::Group& group) {
    Struct object;
    Set("rows", static_cast<double>(group.rows), &object);
    Set("windows", static_cast<double>(group.windows), &object);
    Set("probability", group.probability, &object);
    Set("surprise", group.surprise, &object);
    Set("ade", group.ade, &object);
    Set("share", group.share, &object);
    return object;
  }

  // Ids are text, as in all JSON of protobuf: a number with 64 bits is none in JavaScript.
  Struct RowJson(const tags::Match& match, size_t row) const {
    Struct object;
    Set("dataset", ShardOf(match).file.dataset(), &object);
    Set("name", ActionName(match, row), &object);
    for (size_t i = 0; i < tags::kColumns; ++i) {
      const auto column = static_cast<Column>(i);
      const std::string name(tags::SpecOf(column).name);
      if (column == Column::kScene) {
        Set(name, ShardOf(match).Scene(row), &object);
      } else if (column == Column::kTarget || column == Column::kClass) {
        Set(name, Text(match, row, column), &object);
      } else {
        Set(name, tags::ToNumber(column, ShardOf(match).tags->Value(column, row)), &object);
      }
    }
    return object;
  }

  Struct Json() const {
    Struct answer = GroupJson(found_.all);
    Set("missingShards", static_cast<double>(set_.missing), &answer);
    auto* rows = (*answer.mutable_fields())["matches"].mutable_list_value();
    for (const tags::Match& match : matches_) {
      Struct row = RowJson(match, match.row);
      if (match.following) {
        *(*row.mutable_fields())["followedBy"].mutable_struct_value() =
            RowJson(match, *match.following);
      }
      if (match.other) {
        *(*row.mutable_fields())["other"].mutable_struct_value() = RowJson(match, *match.other);
      }
      *rows->add_values()->mutable_struct_value() = std::move(row);
    }
    if (arguments_.by.empty()) return answer;
    AddCounts(found_, against_, &answer);
    if (arguments_.per.empty()) return answer;
    auto* parts = (*answer.mutable_fields())["parts"].mutable_struct_value();
    for (const std::string& part : PartNames(found_, against_)) {
      Struct object = GroupJson(PartOf(found_, part).all);
      AddCounts(PartOf(found_, part), against_ == nullptr ? nullptr : &PartOf(*against_, part),
                &object);
      *(*parts->mutable_fields())[part].mutable_struct_value() = std::move(object);
    }
    return answer;
  }

  static void AddCounts(const tags::Statistics& these, const tags::Statistics* those,
                        Struct* answer) {
    auto* groups = (*answer->mutable_fields())["groups"].mutable_struct_value();
    for (const auto& [name, group] : these.groups) {
      *(*groups->mutable_fields())[name].mutable_struct_value() = GroupJson(group);
    }
    if (those == nullptr) return;
    auto* changes = (*answer->mutable_fields())["changes"].mutable_struct_value();
    for (const std::string& name : ComparedGroups(these, *those)) {
      const tags::Change change = tags::Compare(these, *those, name);
      Struct object;
      Set("share", ShareIn(these, name), &object);
      Set("against", ShareIn(*those, name), &object);
      Set("difference", change.difference, &object);
      Set("low", change.low, &object);
      Set("high", change.high, &object);
      *(*changes->mutable_fields())[name].mutable_struct_value() = std::move(object);
    }
  }

  absl::Status PlotShares() {
    const auto picture = plot::DrawShares(SharePlotOf(
        found_, against_, arguments_.by, arguments_.per, absl::StrJoin(arguments_.folders, " "),
        absl::StrJoin(arguments_.against, " ")));
    if (!picture.ok()) return picture.status();
    if (absl::Status status = WriteFile(*arguments_.plot, *picture); !status.ok()) return status;
    environment_.err << "the picture is " << *arguments_.plot << "\n";
    return absl::OkStatus();
  }

  absl::Status Plot() {
    std::vector<v1::Scenario> shown;
    for (const tags::Match& match : matches_) {
      if (shown.size() == kMostPanels) break;
      absl::StatusOr<v1::Scenario> scene = scenes_.Scene(match, at_peak_);
      if (!scene.ok()) return scene.status();
      shown.push_back(*std::move(scene));
    }
    if (shown.empty()) return absl::NotFoundError("there is no match to draw");
    const auto picture = plot::DrawRecordings(shown, {});
    if (!picture.ok()) return picture.status();
    if (absl::Status status = WriteFile(*arguments_.plot, *picture); !status.ok()) return status;
    environment_.err << "the picture is " << *arguments_.plot;
    if (shown.size() < matches_.size()) {
      environment_.err << ", of the first " << shown.size() << " matches";
    }
    environment_.err << "\n";
    return absl::OkStatus();
  }

  absl::Status Extract() {
    std::error_code error;
    fs::create_directories(arguments_.extract, error);
    if (error) {
      return absl::FailedPreconditionError(
          absl::StrCat("cannot make ", arguments_.extract, ": ", error.message()));
    }
    int number = 0;
    for (const tags::Match& match : matches_) {
      const absl::StatusOr<v1::Scenario> scene = scenes_.Scene(match, at_peak_);
      if (!scene.ok()) return scene.status();
      // An id may have any characters.
      std::string id = scene->scenario_id();
      std::ranges::replace_if(
          id,
          [](char c) { return !absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '-'; },
          '_');
      const std::string name =
          absl::StrFormat("%04d-%s-%d.json", ++number, id, scene->target_ids(0));
      const absl::Status status =
          WriteFile((fs::path(arguments_.extract) / name).string(), ToCompactJson(*scene));
      if (!status.ok()) return status;
    }
    environment_.err << arguments_.extract << " has " << HowMany(number, "scene") << "\n";
    return absl::OkStatus();
  }

  absl::Status WriteDataset() {
    if (matches_.empty()) return absl::NotFoundError("there is no match to make a dataset of");
    const Interrupt interrupt([] {});  // before the folder, so that Ctrl-C leaves nothing of it
    auto writer = data::DatasetWriter::Create(arguments_.as_dataset, "found by maneuver find");
    if (!writer.ok()) return writer.status();
    std::set<std::pair<std::string, std::string>> added;  // dataset and id
    std::set<std::string> names;
    std::map<std::string, int> times_seen;
    for (const tags::Match& match : matches_) {
      if (interrupt.happened()) return absl::CancelledError("interrupted");
      const tags::TaggedShard& shard = ShardOf(match);
      if (!added.emplace(shard.file.dataset(), shard.Scene(match.row)).second) continue;
      absl::StatusOr<v1::Scenario> recording = scenes_.Recording(match);
      if (!recording.ok()) return recording.status();
      const std::string its_own = recording->scenario_id();
      std::string id = its_own;
      while (!names.insert(id).second) id = data::PartId(its_own, ++times_seen[its_own] + 1);
      recording->set_scenario_id(id);
      if (absl::Status status = (*writer)->Add(*recording); !status.ok()) return status;
    }
    const absl::StatusOr<v1::Dataset> dataset = (*writer)->Commit();
    if (!dataset.ok()) return dataset.status();
    environment_.err << arguments_.as_dataset << ": " << HowMany(dataset->recordings(), "recording")
                     << "\n";
    return absl::OkStatus();
  }

  const FindArguments& arguments_;
  const tags::TagSet& set_;
  const tags::Found& found_;
  const tags::Found* const against_;  // of other folders; null: nothing is compared
  const std::vector<tags::Match> matches_;
  const bool at_peak_;
  Environment& environment_;
  FoundScenes scenes_;
};

// Opens folders of tags and answers the query. Says how much is missing.
struct Answered {
  tags::TagSet set;
  tags::Found found;
};
absl::StatusOr<Answered> Ask(const std::vector<std::string>& folders, const tags::TagQuery& query,
                             Environment& environment) {
  absl::StatusOr<tags::TagSet> set = tags::TagSet::Open({folders.begin(), folders.end()});
  if (!set.ok()) return set.status();
  if (set->missing > 0) {
    environment.err << HowMany(set->missing, "shard")
                    << " without tags yet; run maneuver tag again to continue\n";
  }
  absl::StatusOr<tags::Found> found = tags::Find(*set, query);
  if (!found.ok()) return found.status();
  return Answered{*std::move(set), *std::move(found)};
}

int Find(FindArguments arguments, Environment& environment) {
  const absl::StatusOr<tags::TagQuery> query = ReadQuery(&arguments);
  if (!query.ok()) return environment.Refuse(std::string(query.status().message()));
  const bool wants_scenes = (arguments.plot && arguments.by.empty()) ||
                            !arguments.extract.empty() || !arguments.as_dataset.empty();
  if (wants_scenes && arguments.datasets.empty()) {
    return environment.Refuse(
        "--plot without --by, --extract and --as-dataset need the recordings: --dataset FOLDER");
  }
  const absl::Status distinct = CheckFolderNames(arguments.datasets);
  if (!distinct.ok()) return environment.Refuse(std::string(distinct.message()));
  const auto fail = [&](const absl::Status& status) {
    return absl::IsInvalidArgument(status) ? environment.Refuse(std::string(status.message()))
                                           : environment.Fail(status);
  };
  const absl::StatusOr<Answered> answer = Ask(arguments.folders, *query, environment);
  if (!answer.ok()) return fail(answer.status());
  absl::StatusOr<Answered> against = Answered{};
  const bool compares = !arguments.against.empty();
  if (compares) against = Ask(arguments.against, *query, environment);
  if (!against.ok()) return fail(against.status());
  std::vector<tags::Match> matches =
      arguments.distinct ? tags::WithoutNearDuplicates(
                               answer->set, answer->found.matches,
                               static_cast<size_t>(arguments.limit.value_or(kMatchesShown)))
                         : answer->found.matches;
  return Finding(arguments, answer->set, answer->found, compares ? &against->found : nullptr,
                 std::move(matches), query->most_surprising, environment)
      .Answer();
}

}  // namespace

void AddFind(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<FindArguments>();
  Command command = root.Add(
      "find", "Find what targets did, in tags of maneuver tag",
      "All conditions must hold. Patterns are as in a shell: * stands for any text, ? for one "
      "character.\n"
      "Example: maneuver find tags --action \"left turn*\" --min-probability 0.8 --speed 5..12\n"
      "         maneuver find tags --action \"left turn*\" --followed-by \"stop*\" --plot "
      "found.png "
      "--dataset town\n"
      "         maneuver find tags --surprise top:50 --as-dataset surprising --dataset town\n"
      "         maneuver find tags --by action --where class=vehicle\n"
      "         maneuver find tags --by action --per speed --against tags-may --plot shares.png");
  command.Arguments("TAGS", &arguments->folders, "Folders of maneuver tag");
  command.Option("--action", &arguments->actions,
                 "Name or number of an action; may be repeated: any of them");
  command.Option("--scene", &arguments->scenes, "Id of a recording; may be repeated: any of them");
  command.Option("--min-probability", &arguments->min_probability, 0.0, 1.0,
                 "Least p(y|s) of the action");
  command.Option("--speed", &arguments->speed, "Speed at the beginning, m/s: 5..12, 5.. or ..12");
  command.Option("--near", &arguments->near,
                 "X,Y,R: the row begins within R metres of this point of the world");
  command.Option("--surprise", &arguments->surprise,
                 "top:N: the N with the largest -ln p(y|s); or the least -ln p, nats");
  command.Option("--where", &arguments->conditions,
                 "A condition on a column: \"ade > 5\", class=pedestrian");
  command.Option("--followed-by", &arguments->followed_by,
                 "The same target does this next, at most --within later");
  command.Option("--with", &arguments->meanwhile,
                 "Another target of the recording does this at the same time");
  command.Option("--answered-by", &arguments->answered_by,
                 "Another target begins this afterwards, at most --within after the end");
  command.Option("--within", &arguments->within, 0.0, 1e6,
                 "Seconds, for --followed-by and --answered-by [3]");
  command.Option("--distance", &arguments->distance, 0.0, 1e6,
                 "The other target is at most this far away, metres");
  command.Choice("--side", &arguments->side, {"any", "ahead", "behind"},
                 "Where the other target is, as seen from the first one");
  command.Choice("--by", &arguments->by,
                 {"action", "class", "speed", "place", "hour", "scene", "dataset"},
                 "Count by this, instead of listing");
  command.Choice("--per", &arguments->per,
                 {"class", "speed", "place", "hour", "scene", "dataset", "action"},
                 "Count each part of the rows apart; shares are of the part's windows");
  command.Option("--against", &arguments->against,
                 "Compare the shares with those in another folder of tags; may be repeated");
  command.Option("--limit", &arguments->limit, 0, kMostMatches, "Most matches to show [20]");
  command.Flag("--distinct", &arguments->distinct,
               "Leave out near-duplicates: same actions, place, heading, speed and latent");
  command.Option("--dataset", &arguments->datasets,
                 "Folder of a dataset that was tagged, for the next three; may be repeated");
  command.Picture("--plot", &arguments->plot,
                  "PNG file to draw the first 16 matches into; with --by, the shares and their "
                  "intervals");
  command.Option("--extract", &arguments->extract,
                 "Folder for the scenes as JSON, as maneuver predict reads them");
  command.Option("--as-dataset", &arguments->as_dataset,
                 "Folder for a dataset of their recordings; implies --distinct");
  command.Option("--threads", &arguments->threads, 0, 1024, "Threads; 0: one for each core");
  command.Run([arguments, &environment] { return Find(*arguments, environment); });
}

}  // namespace maneuver::cli
