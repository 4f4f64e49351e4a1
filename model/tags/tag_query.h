// Finds rows in folders of tags.

#ifndef MANEUVER_MODEL_TAGS_TAG_QUERY_H_
#define MANEUVER_MODEL_TAGS_TAG_QUERY_H_

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "model/tags/tag_condition.h"
#include "model/tags/tag_set.h"

namespace maneuver::tags {

// Patterns as in a shell: * and ? stand for anything. An action also has its number as a name.
using Patterns = std::vector<std::string>;

// The row must begin at a place.
struct NearPlace {
  double x = 0.0;  // world frame, metres
  double y = 0.0;
  double radius = 0.0;
};

// The same target must later do something else.
struct FollowedBy {
  Patterns actions;     // any of them
  double within = 0.0;  // seconds from the end of the row to the beginning of the other
};

// Another target of the same recording must do something.
struct OtherTarget {
  enum class When {
    kMeanwhile,  // the two rows overlap in time
    kThen,       // the other begins after this one, at most `within` seconds after its end
  };
  enum class Side { kAny, kAhead, kBehind };

  Patterns actions;  // any of them
  When when = When::kMeanwhile;
  double within = 0.0;
  // Position of the other target when the later of the two rows begins, in the frame of this
  // target. Assumes that both drove straight on at constant speed since their row began.
  double distance = std::numeric_limits<double>::infinity();  // metres, at most
  Side side = Side::kAny;
};

// The property by which matches are grouped.
enum class Grouping { kNone, kAction, kClass, kSpeed, kPlace, kHour, kScene, kDataset };

struct TagQuery {
  Patterns actions;                   // any of them; empty: any action
  Patterns scenes;                    // any of them matches the recording's id; empty: any id
  std::vector<Condition> conditions;  // all of them
  std::optional<NearPlace> near;
  std::optional<FollowedBy> followed_by;
  std::optional<OtherTarget> other;
  // The most matches that are returned. All matches are counted.
  size_t limit = 20;
  // Keeps the most surprising, most surprising first. Otherwise the first, in order.
  bool most_surprising = false;
  Grouping grouping = Grouping::kNone;
  // Statistics of these rows are wanted separately: Found.parts. kNone: of all rows together only.
  Grouping parts = Grouping::kNone;
  bool errors = false;  // Group.share_error is wanted
  int threads = 1;
};

struct Match {
  size_t shard = 0;  // of TagSet.shards
  size_t row = 0;
  std::optional<size_t> following;  // row of the same shard that matches FollowedBy
  std::optional<size_t> other;      // row of the same shard that matches OtherTarget
};

// Sums over rows.
struct Group {
  int64_t rows = 0;
  int64_t windows = 0;
  // Means over the windows.
  double probability = 0.0;
  double surprise = 0.0;  // of the rows' largest
  double ade = 0.0;
  double share = 0.0;  // of all matching windows, 0 to 1
  // Standard error of the share, if wanted. Windows of one recording depend on each other, so the
  // recordings are taken to be drawn at random:
  //   sqrt(n / (n - 1) sum_s (w_gs - share w_s)^2) / sum_s w_s,
  // with w_gs windows of the group and w_s in all in recording s, over the n recordings with
  // matches. 0 for fewer than two.
  double share_error = 0.0;
};

// Counts of matching rows.
struct Statistics {
  Group all;
  int64_t scenes = 0;  // recordings with matches, if errors are wanted
  // Groups by name. The name is, by TagQuery::grouping, that of the action or the class; a speed
  // range "5..10" in m/s; a place "300,-100", the middle of a square of 100 m; an hour "17" of the
  // day in UTC, if the clock counts from 1970; or the name of the recording or the dataset. Shares
  // are of the windows counted here.
  std::map<std::string, Group> groups;
};

struct Found : Statistics {
  std::vector<Match> matches;
  // The rows of each part alone, by the part's name: as that of a group, by TagQuery::parts.
  std::map<std::string, Statistics> parts;
};

// Answers a query. Shards that cannot contain a match are not read. INVALID_ARGUMENT if no action
// of any folder has a name that a pattern matches; DATA_LOSS for damaged columns.
absl::StatusOr<Found> Find(const TagSet& set, const TagQuery& query);

// How the share of a group differs between two answers.
struct Change {
  double difference = 0.0;  // the share of the first minus that of the second
  double low = 0.0;         // the interval of 95 %, by the normal distribution
  double high = 0.0;
};

// Compares the shares of a group in two answers; both queries must have `errors`. In an answer that
// lacks the group, the share is 0, and the interval allows for up to 3 / n, where n is the answer's
// number of recordings; it allows for as much if n is 1, or all windows are in the group. If both
// lack it, they do not differ.
Change Compare(const Statistics& first, const Statistics& second, const std::string& group);

// An interval of 95 % for the share of a group. If the group is missing: from 0 to 3 / n.
struct ShareInterval {
  double share = 0.0;
  double low = 0.0;
  double high = 0.0;
};
ShareInterval IntervalOf(const Statistics& statistics, const std::string& group);

// Returns the first of the matches that are not near-duplicates of an earlier one, at most `most`.
// Two rows are near-duplicates if all of this holds:
//   - they have the same action, likeliest action and class;
//   - they begin within 10 m of each other, with headings that differ by at most 30 degrees and
//     speeds that differ by at most 2 m/s;
//   - their latents are near: the means of the action, decoded from E[z|y,s], are within 2.5 m of
//     each other after half of the horizon and within 5 m at the horizon.
// Rows of one target of one recording are near-duplicates, too.
std::vector<Match> WithoutNearDuplicates(const TagSet& set, const std::vector<Match>& matches,
                                         size_t most);

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAG_QUERY_H_
