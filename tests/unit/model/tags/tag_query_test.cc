// tests/fleet/fleet_test.py compares whole answers with another program's.

#include "model/tags/tag_query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "model/files/durable_file.h"
#include "tests/unit/model/tags/tags_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::tags::tag_query_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Returns the numbers of a column in a range around `middle` that fulfil the condition.
std::set<double> Fulfilling(const std::string& text, Column column, int64_t middle) {
  const auto condition = ParseCondition(text);
  EXPECT_TRUE(condition.ok()) << condition.status();
  std::set<double> numbers;
  for (int64_t value = middle - 3; value <= middle + 3; ++value) {
    const bool inside = value >= condition->least && value <= condition->most;
    if (inside != condition->outside) numbers.insert(ToNumber(column, value));
  }
  return numbers;
}

TEST(ConditionTest, ComparesAsDecimalNumbers) {
  const Column column = Column::kAde;
  EXPECT_THAT(Fulfilling("ade > 0.29", column, 29), ElementsAre(0.3, 0.31, 0.32));
  EXPECT_THAT(Fulfilling("ade>=0.29", column, 29), ElementsAre(0.29, 0.3, 0.31, 0.32));
  EXPECT_THAT(Fulfilling("ade < .29", column, 29), ElementsAre(0.26, 0.27, 0.28));
  EXPECT_THAT(Fulfilling("ade<=0.29", column, 29), ElementsAre(0.26, 0.27, 0.28, 0.29));
  EXPECT_THAT(Fulfilling("ade = 0.29", column, 29), ElementsAre(0.29));
  EXPECT_THAT(Fulfilling("ade != 0.29", column, 29),
              ElementsAre(0.26, 0.27, 0.28, 0.3, 0.31, 0.32));
  EXPECT_THAT(Fulfilling("ade > 0.295", column, 29), ElementsAre(0.3, 0.31, 0.32));
  EXPECT_THAT(Fulfilling("ade = 0.295", column, 29), ElementsAre());
  EXPECT_THAT(Fulfilling("x > -0.29", Column::kX, -29), ElementsAre(-0.28, -0.27, -0.26));
}

TEST(ConditionTest, AcceptsNumbersBeyondAllRanges) {
  EXPECT_THAT(Fulfilling("x > -1e300", Column::kX, 0).size(), 7u);
  EXPECT_THAT(Fulfilling("x < -1e300", Column::kX, 0).size(), 0u);
  EXPECT_THAT(Fulfilling("x < 1e300", Column::kX, 0).size(), 7u);
  EXPECT_THAT(Fulfilling("x = 1e300", Column::kX, 0).size(), 0u);
}

// 2^53 + 1 and 2^60 + 3 have no double.
TEST(ConditionTest, FindsEachIdWhateverItsSize) {
  for (const int64_t id :
       {(int64_t{1} << 53) + 1, (int64_t{1} << 60) + 3, -(int64_t{1} << 60) - 3}) {
    const auto condition = ParseCondition("target = " + std::to_string(id));
    ASSERT_TRUE(condition.ok()) << condition.status();
    EXPECT_EQ(condition->least, id);
    EXPECT_EQ(condition->most, id);
    EXPECT_EQ(ParseCondition("target > " + std::to_string(id))->least, id + 1);
  }
}

TEST(ConditionTest, NearlyNothingIsLessThanTheLeastInteger) {
  const auto condition = ParseCondition("target < -9223372036854775808");
  ASSERT_TRUE(condition.ok()) << condition.status();
  EXPECT_EQ(condition->most, std::numeric_limits<int64_t>::min());
}

TEST(CompareTest, ASingleRecordingDecidesNothing) {
  Statistics first;
  Statistics second;
  first.scenes = second.scenes = 1;
  first.groups["fast"].share = 0.5;
  second.groups["fast"].share = 1.0;
  const Change change = Compare(first, second, "fast");
  EXPECT_EQ(change.difference, -0.5);
  EXPECT_GT(change.high, 0.0);
  // All of many recordings are something, too.
  second.scenes = 1000;
  EXPECT_LT(IntervalOf(second, "fast").low, 1.0);
}

TEST(ConditionTest, AClassHasAName) {
  const auto condition = ParseCondition("class = cyclist");
  ASSERT_TRUE(condition.ok());
  EXPECT_EQ(condition->least, v1::AGENT_TYPE_CYCLIST);
  EXPECT_EQ(condition->most, v1::AGENT_TYPE_CYCLIST);
  EXPECT_THAT(std::string(ParseCondition("class=tram").status().message()), HasSubstr("vehicle"));
}

class TagQueryTest : public ::testing::Test {
 protected:
  TagQueryTest() {
    const Schema schema =
        *PrepareTagFolder(folder_.path() / "tags", SmallSchema({"town-a", "town-b", "town-c"}));
    WriteTags(
        folder_.path() / "tags", schema, schema.content.files(0),
        {{"s1", {RowWith({{Column::kX, -150.0}, {Column::kY, 20.0}, {Column::kSpeed, 3.0}})}}});
    WriteTags(folder_.path() / "tags", schema, schema.content.files(1),
              {{"s2",
                {RowWith({{Column::kTarget, 1}, {Column::kAction, 2}, {Column::kFrom, 90000.0}}),
                 RowWith({{Column::kTarget, 2},
                          {Column::kAction, 1},
                          {Column::kFrom, -1.0},
                          {Column::kSpeed, 12.0}})}}});
    set_ = *TagSet::Open({folder_.path() / "tags"});
  }

  Found Ask(const TagQuery& query) const {
    const auto found = Find(set_, query);
    EXPECT_TRUE(found.ok()) << found.status();
    return found.value_or(Found());
  }
  std::vector<std::string> Groups(Grouping grouping) const {
    TagQuery query;
    query.grouping = grouping;
    std::vector<std::string> names;
    for (const auto& [name, group] : Ask(query).groups) names.push_back(name);
    return names;
  }

  TemporaryFolder folder_;
  TagSet set_;
};

TEST_F(TagQueryTest, CountsShardsWithoutTagsAsMissing) {
  EXPECT_EQ(set_.missing, 1);
  EXPECT_EQ(Ask({}).all.rows, 3);
}

TEST_F(TagQueryTest, GroupsHaveTheNamesOfTheirRanges) {
  EXPECT_THAT(Groups(Grouping::kPlace), ElementsAre("-150,50", "50,50"));
  EXPECT_THAT(Groups(Grouping::kSpeed), ElementsAre("0..5", "10..15"));
  // 90,000 s are 25 hours.
  EXPECT_THAT(Groups(Grouping::kHour), ElementsAre("0", "1", "23"));
}

TEST_F(TagQueryTest, AShardThatCannotMatchIsNotRead) {
  // The damage is in a shard whose head says that it has no such action, and none that far west.
  const auto file = folder_.path() / "tags/town-b.tags";
  std::string bytes = *files::ReadFile(file);
  // The columns of two rows take 224 bytes, after the header.
  for (size_t i = bytes.size() - 216; i < bytes.size(); ++i) bytes[i] ^= 1;
  WriteBytes(file, bytes);
  const TagSet damaged = *TagSet::Open({folder_.path() / "tags"});
  TagQuery query;
  EXPECT_TRUE(absl::IsDataLoss(Find(damaged, query).status()));
  query.actions = {"left*"};
  EXPECT_EQ(Find(damaged, query)->all.rows, 1);
  query.actions.clear();
  query.near = NearPlace{-150.0, 20.0, 1.0};
  EXPECT_EQ(Find(damaged, query)->all.rows, 1);
  query.near.reset();
  query.conditions = {Between(Column::kY, 19.0, 21.0)};
  EXPECT_EQ(Find(damaged, query)->all.rows, 1);
}

TEST_F(TagQueryTest, RefusesAnUnknownActionAndListsTheKnownOnes) {
  TagQuery query;
  query.actions = {"flies"};
  const absl::Status status = Find(set_, query).status();
  EXPECT_TRUE(absl::IsInvalidArgument(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("keep speed; left turn, slowing; stop"));
}

// Returns which of these rows remain without near-duplicates. Each is of another target.
std::vector<int64_t> Distinct(std::vector<std::map<Column, double>> numbers) {
  TemporaryFolder folder;
  const Schema schema = *PrepareTagFolder(folder.path() / "tags", SmallSchema());
  std::vector<CsvRow> rows;
  std::vector<Match> matches;
  for (size_t i = 0; i < numbers.size(); ++i) {
    numbers[i].emplace(Column::kTarget, static_cast<double>(i));
    rows.push_back(RowWith(numbers[i]));
    matches.emplace_back().row = i;
  }
  WriteTags(folder.path() / "tags", schema, schema.content.files(0), {{"s", rows}});
  const TagSet set = *TagSet::Open({folder.path() / "tags"});
  std::vector<int64_t> left;
  for (const Match& match : WithoutNearDuplicates(set, matches, 10)) {
    left.push_back(static_cast<int64_t>(match.row));
  }
  return left;
}

TEST(NearDuplicatesTest, RowsAreAlikeOnlyInPlaceAndLatent) {
  const std::map<Column, double> row = {
      {Column::kX, 10.0},    {Column::kY, 5.0},    {Column::kHeading, 3.1}, {Column::kSpeed, 8.0},
      {Column::kMidX, 18.0}, {Column::kMidY, 2.0}, {Column::kEndX, 30.0},   {Column::kEndY, 12.0}};
  // How far each number may be from that of a near-duplicate.
  const std::map<Column, double> room = {
      {Column::kX, 10.0},   {Column::kY, 10.0},   {Column::kHeading, 0.52}, {Column::kSpeed, 2.0},
      {Column::kMidX, 2.5}, {Column::kMidY, 2.5}, {Column::kEndX, 5.0},     {Column::kEndY, 5.0}};
  for (const auto& [column, most] : room) {
    SCOPED_TRACE(SpecOf(column).name);
    std::map<Column, double> near = row;
    near[column] -= 0.99 * most;
    EXPECT_THAT(Distinct({row, near}), ElementsAre(0));
    std::map<Column, double> far = row;
    far[column] -= 1.02 * most;
    EXPECT_THAT(Distinct({row, far}), ElementsAre(0, 1));
  }
  std::map<Column, double> turned = row;
  turned[Column::kHeading] = -3.1;  // beyond pi
  EXPECT_THAT(Distinct({row, turned}), ElementsAre(0));
  std::map<Column, double> other = row;
  other[Column::kAction] = 1;
  EXPECT_THAT(Distinct({row, other}), ElementsAre(0, 1));
}

TEST(NearDuplicatesTest, ATargetIsThereOnce) {
  EXPECT_THAT(Distinct({{{Column::kTarget, 7.0}}, {{Column::kTarget, 7.0}, {Column::kX, 500.0}}}),
              ElementsAre(0));
}

}  // namespace
}  // namespace maneuver::tags::tag_query_test
