#include "model/tags/tag_query.h"

#include <fnmatch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <span>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "model/machine/parallel.h"

namespace maneuver::tags {
namespace {

constexpr size_t kBlock = size_t{1} << 16;  // rows that are tested at a time
constexpr size_t kStep = 4096;              // rows whose tests stay in the nearest cache
constexpr double kSpeedStep = 5.0;          // metres per second
constexpr double kPlaceStep = 100.0;        // metres
constexpr int64_t kSecondsOfHour = 3600;
constexpr int64_t kHoursOfDay = 24;

bool MatchesAny(const Patterns& patterns, const std::string& name) {
  return std::ranges::any_of(patterns, [&](const std::string& pattern) {
    return fnmatch(pattern.c_str(), name.c_str(), 0) == 0;
  });
}

// Which actions of a schema the patterns mean. [K]; empty patterns mean all of them.
std::vector<uint8_t> ActionsOf(const Schema& schema, const Patterns& patterns) {
  std::vector<uint8_t> chosen;
  for (int i = 0; i < schema.content.action_names_size(); ++i) {
    chosen.push_back(static_cast<uint8_t>(patterns.empty() ||
                                          MatchesAny(patterns, schema.content.action_names(i)) ||
                                          MatchesAny(patterns, absl::StrCat(i))));
  }
  return chosen;
}

bool Any(const std::vector<uint8_t>& flags) {
  return std::ranges::any_of(flags, [](uint8_t flag) { return flag != 0; });
}

absl::Status CheckPatterns(const TagSet& set, const Patterns& patterns) {
  std::set<std::string> names;
  for (const TaggedShard& shard : set.shards) {
    if (Any(ActionsOf(*shard.schema, patterns))) return absl::OkStatus();
    names.insert(shard.schema->content.action_names().begin(),
                 shard.schema->content.action_names().end());
  }
  if (set.shards.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("no action is called \"",
                                                 absl::StrJoin(patterns, "\" or \""),
                                                 "\"; there are: ", absl::StrJoin(names, "; ")));
}

int64_t FloorDivide(int64_t a, int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

// What a query means for one shard.
struct ShardQuery {
  const TaggedShard* shard;
  std::vector<uint8_t> actions;
  std::vector<uint8_t> following;
  std::vector<uint8_t> others;
  std::vector<uint8_t> scenes;  // [scenes]; empty: all of them
};

// Clears the flags of rows whose value is not in the range, or is.
template <typename Integer>
void Test(const Condition& condition, const Integer* values, std::span<uint8_t> flags) {
  const int64_t least = std::max<int64_t>(condition.least, std::numeric_limits<Integer>::min());
  const int64_t most = std::min<int64_t>(condition.most, std::numeric_limits<Integer>::max());
  const auto outside = static_cast<uint8_t>(condition.outside);
  if (least > most) {
    for (uint8_t& flag : flags) flag &= outside;
    return;
  }
  const auto low = static_cast<Integer>(least);
  const auto high = static_cast<Integer>(most);
  for (size_t i = 0; i < flags.size(); ++i) {
    flags[i] &=
        static_cast<uint8_t>(static_cast<uint8_t>(values[i] >= low && values[i] <= high) ^ outside);
  }
}

// The sums of one group while rows are added.
struct Sums {
  int64_t rows = 0;
  int64_t windows = 0;
  double probability = 0.0;
  double surprise = 0.0;
  double ade = 0.0;

  void Add(const Sums& other) {
    rows += other.rows;
    windows += other.windows;
    probability += other.probability;
    surprise += other.surprise;
    ade += other.ade;
  }
  Group Mean(int64_t all_windows) const {
    const auto count = static_cast<double>(std::max<int64_t>(1, windows));
    Group group{rows, windows, probability / count, surprise / count, ade / count};
    group.share =
        static_cast<double>(windows) / static_cast<double>(std::max<int64_t>(1, all_windows));
    return group;
  }
};

// What one part of the scan found.
struct Part {
  Sums all;
  std::vector<Match> matches;
  int64_t least_surprise = std::numeric_limits<int64_t>::min();  // of a row that may be kept
  // By the keys of the part and the group within the shard. A query without parts has the part 0.
  std::unordered_map<int64_t, std::unordered_map<int64_t, Sums>> groups;
  // Windows by part, group and number of the recording in the shard. Empty unless errors are wanted.
  std::map<std::tuple<int64_t, int64_t, int64_t>, int64_t> scene_groups;
};

using Scene = std::pair<size_t, int64_t>;  // shard, number of the recording in it

// What becomes Statistics.
struct Counts {
  std::map<std::string, Sums> groups;
  // Windows of each recording, in all and by group; empty unless errors are wanted.
  std::map<Scene, double> scenes;
  std::map<std::string, std::map<Scene, double>> scene_groups;

  void Add(const std::string& group, const Scene& scene, int64_t windows) {
    scenes[scene] += static_cast<double>(windows);
    scene_groups[group][scene] += static_cast<double>(windows);
  }

  Statistics Evaluate() const {
    Statistics statistics;
    Sums all;
    for (const auto& [name, sums] : groups) all.Add(sums);
    statistics.all = all.Mean(all.windows);
    for (const auto& [name, sums] : groups) statistics.groups[name] = sums.Mean(all.windows);
    statistics.scenes = static_cast<int64_t>(scenes.size());
    if (scenes.size() < 2) return statistics;
    const auto count = static_cast<double>(scenes.size());
    double squares = 0.0;
    for (const auto& [scene, windows] : scenes) squares += windows * windows;
    for (auto& [name, group] : statistics.groups) {
      // Recordings without the group have a part in the sum as well.
      double sum = group.share * group.share * squares;
      for (const auto& [scene, windows] : scene_groups.at(name)) {
        sum += windows * (windows - 2.0 * group.share * scenes.at(scene));
      }
      group.share_error =
          std::sqrt(std::max(0.0, sum) * count / (count - 1.0)) / static_cast<double>(all.windows);
    }
    return statistics;
  }
};

class Scan {
 public:
  Scan(const TagSet& set, const TagQuery& query) : set_(set), query_(query) {}

  absl::StatusOr<Found> Run() {
    for (const Patterns* patterns :
         {&query_.actions, query_.followed_by ? &query_.followed_by->actions : nullptr,
          query_.other ? &query_.other->actions : nullptr}) {
      if (patterns == nullptr) continue;
      if (absl::Status status = CheckPatterns(set_, *patterns); !status.ok()) return status;
    }
    for (const TaggedShard& shard : set_.shards) {
      ShardQuery asked{&shard, ActionsOf(*shard.schema, query_.actions), {}, {}, {}};
      if (query_.followed_by) {
        asked.following = ActionsOf(*shard.schema, query_.followed_by->actions);
      }
      if (query_.other) asked.others = ActionsOf(*shard.schema, query_.other->actions);
      if (!query_.scenes.empty()) {
        for (const std::string& scene : shard.tags->head().scenes()) {
          asked.scenes.push_back(static_cast<uint8_t>(MatchesAny(query_.scenes, scene)));
        }
      }
      asked_.push_back(std::move(asked));
    }
    if (absl::Status status = Verify(); !status.ok()) return status;
    Found found = Answer(ScanBlocks());
    if (absl::Status status = VerifyMatches(found); !status.ok()) return status;
    return found;
  }

 private:
  struct Block {
    size_t shard;
    size_t begin;
    size_t end;
  };

  // Returns whether a shard can contain a match, by what its head says.
  bool MayMatch(const ShardQuery& asked) const {
    const TagHead& head = asked.shard->tags->head();
    int64_t rows = 0;
    for (size_t i = 0; i < asked.actions.size(); ++i) {
      if (asked.actions[i] != 0) rows += head.action_rows(static_cast<int>(i));
    }
    if (rows == 0 || (!query_.scenes.empty() && !Any(asked.scenes))) return false;
    const auto overlaps = [&](Column column, int64_t least, int64_t most) {
      const TagColumnPart& part = head.columns(static_cast<int>(column));
      return part.least() <= most && part.most() >= least;
    };
    if (query_.near) {
      const auto around = [&](Column column, double middle) {
        const Condition box =
            Between(column, middle - query_.near->radius, middle + query_.near->radius);
        return overlaps(column, box.least, box.most);
      };
      if (!around(Column::kX, query_.near->x) || !around(Column::kY, query_.near->y)) return false;
    }
    return std::ranges::all_of(query_.conditions, [&](const Condition& condition) {
      return condition.outside || overlaps(condition.column, condition.least, condition.most);
    });
  }

  // The columns whose values the scan uses. Their order does not matter.
  std::set<Column> Used() const {
    std::set<Column> used = {Column::kAction, Column::kWindows, Column::kProbability,
                             Column::kSurprise, Column::kAde};
    for (const Condition& condition : query_.conditions) used.insert(condition.column);
    if (!query_.scenes.empty() || query_.errors) used.insert(Column::kScene);
    if (query_.near) used.merge(Set(kPlace));
    if (query_.followed_by) used.merge(Set(kSequence));
    if (query_.other) {
      used.merge(Set(kSequence));
      used.merge(Set(kPlace));
      used.merge(Set({Column::kSpeed, Column::kHeading}));
    }
    for (const Grouping grouping : {query_.grouping, query_.parts}) {
      if (grouping == Grouping::kScene) used.insert(Column::kScene);
      if (grouping == Grouping::kPlace) used.merge(Set(kPlace));
      if (grouping == Grouping::kClass) used.insert(Column::kClass);
      if (grouping == Grouping::kSpeed) used.insert(Column::kSpeed);
      if (grouping == Grouping::kHour) used.insert(Column::kFrom);
    }
    return used;
  }
  static std::set<Column> Set(const std::vector<Column>& columns) {
    return {columns.begin(), columns.end()};
  }

  // Checks the used columns of all shards that may match, and lists their blocks.
  absl::Status Verify() {
    const std::set<Column> used = Used();
    std::vector<std::pair<size_t, Column>> checks;
    for (size_t shard = 0; shard < asked_.size(); ++shard) {
      if (!MayMatch(asked_[shard])) continue;
      for (const Column column : used) checks.emplace_back(shard, column);
      const size_t rows = asked_[shard].shard->tags->rows();
      for (size_t begin = 0; begin < rows; begin += kBlock) {
        blocks_.push_back({shard, begin, std::min(rows, begin + kBlock)});
      }
    }
    return machine::ForEachOnThreads(checks.size(), query_.threads, [&](size_t i) {
      return asked_[checks[i].first].shard->tags->Verify(checks[i].second);
    });
  }

  // Checks all columns of the shards that have matches, because printing reads them.
  absl::Status VerifyMatches(const Found& found) const {
    std::set<size_t> shards;
    for (const Match& match : found.matches) shards.insert(match.shard);
    const std::set<Column> verified = Used();
    for (const size_t shard : shards) {
      for (size_t i = 0; i < kColumns; ++i) {
        const auto column = static_cast<Column>(i);
        if (verified.contains(column)) continue;
        const absl::Status status = set_.shards[shard].tags->Verify(column);
        if (!status.ok()) return status;
      }
    }
    return absl::OkStatus();
  }

  std::vector<Part> ScanBlocks() const {
    std::vector<Part> parts(blocks_.size());
    machine::ForEachOnThreads(blocks_.size(), query_.threads,
                              [&](size_t i) { ScanBlock(blocks_[i], &parts[i]); });
    return parts;
  }

  void ScanBlock(const Block& block, Part* part) const {
    std::array<uint8_t, kStep> flags;
    for (size_t begin = block.begin; begin < block.end; begin += kStep) {
      const std::span<uint8_t> these(flags.data(), std::min(kStep, block.end - begin));
      TestRows(asked_[block.shard], begin, these);
      for (size_t i = 0; i < these.size(); ++i) {
        if (these[i] != 0) TakeRow(block.shard, begin + i, part);
      }
    }
    Keep(&part->matches);
  }

  void TestRows(const ShardQuery& asked, size_t begin, std::span<uint8_t> flags) const {
    const ShardTags& tags = *asked.shard->tags;
    const int32_t* const actions = tags.Narrow(Column::kAction).data() + begin;
    for (size_t i = 0; i < flags.size(); ++i) {
      flags[i] = asked.actions[static_cast<size_t>(actions[i])];
    }
    for (const Condition& condition : query_.conditions) {
      if (SpecOf(condition.column).bytes == 4) {
        Test(condition, tags.Narrow(condition.column).data() + begin, flags);
      } else {
        Test(condition, tags.Wide(condition.column).data() + begin, flags);
      }
    }
    if (!query_.scenes.empty()) {
      const int32_t* const scenes = tags.Narrow(Column::kScene).data() + begin;
      for (size_t i = 0; i < flags.size(); ++i) {
        flags[i] &= asked.scenes[static_cast<size_t>(scenes[i])];
      }
    }
    if (!query_.near) return;
    for (size_t i = 0; i < flags.size(); ++i) {
      const double dx = NumberOf(tags, Column::kX, begin + i) - query_.near->x;
      const double dy = NumberOf(tags, Column::kY, begin + i) - query_.near->y;
      const double radius = query_.near->radius;
      flags[i] &= static_cast<uint8_t>(dx * dx + dy * dy <= radius * radius);
    }
  }

  static double NumberOf(const ShardTags& tags, Column column, size_t row) {
    return ToNumber(column, tags.Value(column, row));
  }

  // Takes a row that passed the tests of its own columns, if the rows around it match as well.
  void TakeRow(size_t shard, size_t row, Part* part) const {
    const ShardQuery& asked = asked_[shard];
    const ShardTags& tags = *asked.shard->tags;
    Match match{shard, row, std::nullopt, std::nullopt};
    if (query_.followed_by) {
      match.following = Following(asked, row);
      if (!match.following) return;
    }
    if (query_.other) {
      match.other = Other(asked, row);
      if (!match.other) return;
    }
    const int64_t windows = tags.Narrow(Column::kWindows)[row];
    const auto weight = static_cast<double>(windows);
    const Sums sums{1, windows, weight * NumberOf(tags, Column::kProbability, row),
                    weight * NumberOf(tags, Column::kSurprise, row),
                    weight * NumberOf(tags, Column::kAde, row)};
    part->all.Add(sums);
    if (query_.grouping != Grouping::kNone) {
      const int64_t part_key = KeyOf(query_.parts, tags, row);
      const int64_t key = KeyOf(query_.grouping, tags, row);
      part->groups[part_key][key].Add(sums);
      if (query_.errors) {
        part->scene_groups[{part_key, key, tags.Narrow(Column::kScene)[row]}] += windows;
      }
    }
    if (query_.limit == 0) return;
    if (!query_.most_surprising) {
      if (part->matches.size() < query_.limit) part->matches.push_back(match);
      return;
    }
    if (tags.Narrow(Column::kSurprise)[row] < part->least_surprise) return;
    part->matches.push_back(match);
    if (part->matches.size() < 2 * query_.limit) return;
    Keep(&part->matches);
    part->least_surprise = tags.Narrow(Column::kSurprise)[part->matches.back().row];
  }

  // Drops matches beyond the limit.
  void Keep(std::vector<Match>* matches) const {
    if (query_.most_surprising) {
      const auto order = [&](const Match& match) {
        return std::tuple(-set_.shards[match.shard].tags->Value(Column::kSurprise, match.row),
                          match.shard, match.row);
      };
      std::ranges::sort(*matches, {}, order);
    }
    if (matches->size() > query_.limit) matches->resize(query_.limit);
  }

  std::optional<size_t> Following(const ShardQuery& asked, size_t row) const {
    const ShardTags& tags = *asked.shard->tags;
    const auto scenes = tags.Narrow(Column::kScene);
    const auto targets = tags.Wide(Column::kTarget);
    const double end = NumberOf(tags, Column::kTo, row);
    for (size_t next = row + 1; next < tags.rows(); ++next) {
      if (scenes[next] != scenes[row] || targets[next] != targets[row]) break;
      if (NumberOf(tags, Column::kFrom, next) - end > query_.followed_by->within + kRounding) break;
      if (asked.following[static_cast<size_t>(tags.Narrow(Column::kAction)[next])] != 0) {
        return next;
      }
    }
    return std::nullopt;
  }

  std::optional<size_t> Other(const ShardQuery& asked, size_t row) const {
    const ShardTags& tags = *asked.shard->tags;
    const auto scenes = tags.Narrow(Column::kScene);
    size_t begin = row;
    while (begin > 0 && scenes[begin - 1] == scenes[row]) --begin;
    for (size_t other = begin; other < tags.rows() && scenes[other] == scenes[row]; ++other) {
      if (tags.Wide(Column::kTarget)[other] == tags.Wide(Column::kTarget)[row]) continue;
      if (asked.others[static_cast<size_t>(tags.Narrow(Column::kAction)[other])] == 0) continue;
      if (IsInTime(tags, row, other) && IsInPlace(tags, row, other)) return other;
    }
    return std::nullopt;
  }

  bool IsInTime(const ShardTags& tags, size_t row, size_t other) const {
    const double begin = NumberOf(tags, Column::kFrom, row);
    const double end = NumberOf(tags, Column::kTo, row);
    const double other_begin = NumberOf(tags, Column::kFrom, other);
    if (query_.other->when == OtherTarget::When::kMeanwhile) {
      return other_begin <= end && NumberOf(tags, Column::kTo, other) >= begin;
    }
    return other_begin > begin && other_begin <= end + query_.other->within + kRounding;
  }

  bool IsInPlace(const ShardTags& tags, size_t row, size_t other) const {
    const OtherTarget& wanted = *query_.other;
    const double time =
        std::max(NumberOf(tags, Column::kFrom, row), NumberOf(tags, Column::kFrom, other));
    const auto [x, y] = PlaceAt(tags, row, time);
    const auto [other_x, other_y] = PlaceAt(tags, other, time);
    const double dx = other_x - x;
    const double dy = other_y - y;
    if (std::hypot(dx, dy) > wanted.distance) return false;
    if (wanted.side == OtherTarget::Side::kAny) return true;
    const double heading = NumberOf(tags, Column::kHeading, row);
    const double ahead = dx * std::cos(heading) + dy * std::sin(heading);
    return wanted.side == OtherTarget::Side::kAhead ? ahead > 0.0 : ahead < 0.0;
  }

  static std::pair<double, double> PlaceAt(const ShardTags& tags, size_t row, double time) {
    const double driven =
        NumberOf(tags, Column::kSpeed, row) * (time - NumberOf(tags, Column::kFrom, row));
    const double heading = NumberOf(tags, Column::kHeading, row);
    return {NumberOf(tags, Column::kX, row) + driven * std::cos(heading),
            NumberOf(tags, Column::kY, row) + driven * std::sin(heading)};
  }

  static int64_t KeyOf(Grouping grouping, const ShardTags& tags, size_t row) {
    const auto step = [&](Column column, double width) {
      return FloorDivide(tags.Value(column, row),
                         std::llround(width * std::pow(10.0, SpecOf(column).decimals)));
    };
    switch (grouping) {
      case Grouping::kAction:
        return tags.Value(Column::kAction, row);
      case Grouping::kClass:
        return tags.Value(Column::kClass, row);
      case Grouping::kSpeed:
        return step(Column::kSpeed, kSpeedStep);
      case Grouping::kPlace:
        // At most 1e8 m, so 32 bits are enough.
        return (step(Column::kX, kPlaceStep) << 32) + (step(Column::kY, kPlaceStep) & 0xffffffff);
      case Grouping::kHour: {
        const int64_t hour = step(Column::kFrom, kSecondsOfHour);
        return hour - kHoursOfDay * FloorDivide(hour, kHoursOfDay);
      }
      case Grouping::kScene:
        return tags.Value(Column::kScene, row);
      case Grouping::kNone:
      case Grouping::kDataset:
        break;
    }
    return 0;
  }

  static std::string NameOf(Grouping grouping, const TaggedShard& shard, int64_t key) {
    const auto middle = [](int64_t step) {
      return absl::StrCat(kPlaceStep * (static_cast<double>(step) + 0.5));
    };
    switch (grouping) {
      case Grouping::kAction:
        return shard.ActionName(key);
      case Grouping::kClass:
        return ClassName(key);
      case Grouping::kSpeed:
        return absl::StrCat(kSpeedStep * static_cast<double>(key), "..",
                            kSpeedStep * static_cast<double>(key + 1));
      case Grouping::kPlace: {
        const auto y = static_cast<int32_t>(key & 0xffffffff);
        return absl::StrCat(middle(key >> 32), ",", middle(y));
      }
      case Grouping::kHour:
        return absl::StrCat(key);
      case Grouping::kScene:
        return shard.tags->head().scenes(static_cast<int>(key));
      case Grouping::kNone:
      case Grouping::kDataset:
        break;
    }
    return shard.file.dataset();
  }

  Found Answer(const std::vector<Part>& parts) const {
    Found found;
    Sums all;
    Counts together;
    std::map<std::string, Counts> apart;
    for (size_t i = 0; i < parts.size(); ++i) {
      all.Add(parts[i].all);
      for (const Match& match : parts[i].matches) {
        if (query_.most_surprising || found.matches.size() < query_.limit) {
          found.matches.push_back(match);
        }
      }
      const TaggedShard& shard = set_.shards[blocks_[i].shard];
      for (const auto& [part, groups] : parts[i].groups) {
        Counts& counts = apart[NameOf(query_.parts, shard, part)];
        for (const auto& [key, sums] : groups) {
          const std::string name = NameOf(query_.grouping, shard, key);
          together.groups[name].Add(sums);
          counts.groups[name].Add(sums);
        }
      }
      for (const auto& [keys, windows] : parts[i].scene_groups) {
        const auto& [part, key, scene] = keys;
        const std::string name = NameOf(query_.grouping, shard, key);
        const Scene of{blocks_[i].shard, scene};
        together.Add(name, of, windows);
        apart[NameOf(query_.parts, shard, part)].Add(name, of, windows);
      }
    }
    Keep(&found.matches);
    static_cast<Statistics&>(found) = together.Evaluate();
    found.all = all.Mean(all.windows);
    if (query_.parts == Grouping::kNone) return found;
    for (const auto& [name, counts] : apart) found.parts[name] = counts.Evaluate();
    return found;
  }

  static constexpr double kRounding = 5e-4;  // seconds: times have 3 decimals
  inline static const std::vector<Column> kPlace = {Column::kX, Column::kY};
  inline static const std::vector<Column> kSequence = {Column::kScene, Column::kTarget,
                                                       Column::kFrom, Column::kTo};

  const TagSet& set_;
  const TagQuery& query_;
  std::vector<ShardQuery> asked_;  // as TagSet.shards
  std::vector<Block> blocks_;
};

constexpr double kNormal95 = 1.959964;

struct Estimate {
  double share;
  double error;
};

Estimate EstimateOf(const Statistics& statistics, const std::string& group) {
  const double unseen =
      3.0 / static_cast<double>(std::max<int64_t>(1, statistics.scenes)) / kNormal95;
  const auto known = statistics.groups.find(group);
  if (known == statistics.groups.end()) return {0.0, unseen};
  const double share = known->second.share;
  const double error = known->second.share_error;
  // A single recording has no spread, and neither have shares that are all 1.
  const bool is_unknown = statistics.scenes < 2 || share >= 1.0;
  return {share, is_unknown ? std::max(error, unseen) : error};
}

}  // namespace

absl::StatusOr<Found> Find(const TagSet& set, const TagQuery& query) {
  return Scan(set, query).Run();
}

Change Compare(const Statistics& first, const Statistics& second, const std::string& group) {
  if (!first.groups.contains(group) && !second.groups.contains(group)) return {};
  const Estimate a = EstimateOf(first, group);
  const Estimate b = EstimateOf(second, group);
  const double difference = a.share - b.share;
  const double reach = kNormal95 * std::hypot(a.error, b.error);
  return {difference, difference - reach, difference + reach};
}

ShareInterval IntervalOf(const Statistics& statistics, const std::string& group) {
  const Estimate estimate = EstimateOf(statistics, group);
  const double reach = kNormal95 * estimate.error;
  return {estimate.share, std::max(0.0, estimate.share - reach),
          std::min(1.0, estimate.share + reach)};
}

std::vector<Match> WithoutNearDuplicates(const TagSet& set, const std::vector<Match>& matches,
                                         size_t most) {
  constexpr double kPlace = 10.0;                               // metres
  constexpr double kHeading = 30.0 * std::numbers::pi / 180.0;  // radians
  constexpr double kSpeed = 2.0;                                // metres per second
  constexpr double kMid = 2.5;                                  // metres
  constexpr double kEnd = 5.0;                                  // metres
  const auto number = [&](const Match& match, Column column) {
    return ToNumber(column, set.shards[match.shard].tags->Value(column, match.row));
  };
  const auto kind = [&](const Match& match) {
    const TaggedShard& shard = set.shards[match.shard];
    return std::tuple(shard.ActionName(shard.tags->Value(Column::kAction, match.row)),
                      shard.ActionName(shard.tags->Value(Column::kLikeliest, match.row)),
                      number(match, Column::kClass));
  };
  const auto target = [&](const Match& match) {
    const TaggedShard& shard = set.shards[match.shard];
    return std::tuple(shard.file.dataset(), shard.Scene(match.row),
                      shard.tags->Value(Column::kTarget, match.row));
  };
  const auto similar = [&](const Match& a, const Match& b) {
    const double turn = number(a, Column::kHeading) - number(b, Column::kHeading);
    const auto distance = [&](Column x, Column y) {
      return std::hypot(number(a, x) - number(b, x), number(a, y) - number(b, y));
    };
    return kind(a) == kind(b) && distance(Column::kX, Column::kY) <= kPlace &&
           distance(Column::kMidX, Column::kMidY) <= kMid &&
           distance(Column::kEndX, Column::kEndY) <= kEnd &&
           std::abs(std::remainder(turn, 2.0 * std::numbers::pi)) <= kHeading &&
           std::abs(number(a, Column::kSpeed) - number(b, Column::kSpeed)) <= kSpeed;
  };
  std::vector<Match> chosen;
  for (const Match& match : matches) {
    if (chosen.size() == most) break;
    const bool repeats = std::ranges::any_of(chosen, [&](const Match& earlier) {
      return target(match) == target(earlier) || similar(match, earlier);
    });
    if (!repeats) chosen.push_back(match);
  }
  return chosen;
}

}  // namespace maneuver::tags
