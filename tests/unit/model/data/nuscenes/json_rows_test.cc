#include "model/data/nuscenes/json_rows.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "tests/unit/temporary_folder.h"

namespace maneuver::data::json_rows_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class JsonRowsTest : public testing::Test {
 protected:
  // Reads a file of this text. `visit` may be empty.
  absl::Status Read(const std::string& text, const VisitRow& visit = {}) {
    WriteBytes(folder_ / "rows.json", text);
    return ReadJsonRows(
        folder_ / "rows.json", kTables,
        [&](std::string_view table, std::string_view key, const JsonRow& row) {
          return visit ? visit(table, key, row) : absl::OkStatus();
        },
        [](double) {});
  }
  // Reads one row by `read` and returns its first problem.
  template <typename Reader>
  std::string Problem(const std::string& row, const Reader& read) {
    return std::string(
        Read("[{}, " + row + "]", [&](std::string_view, std::string_view, const JsonRow& found) {
          if (++rows_ % 2 == 0) read(found);
          return found.status();
        }).message());
  }

  static constexpr std::array<std::string_view, 2> kTables = {"node", "paths"};
  const TemporaryFolder folder_;
  int rows_ = 0;
};

TEST_F(JsonRowsTest, VisitsTheRowsOfAnArrayInOrder) {
  std::vector<int64_t> seen;
  const absl::Status status =
      Read(R"([{"a": 1}, {"a": 2, "b": {"a": 9}}, {"a": [], "a": 3}])",
           [&](std::string_view table, std::string_view, const JsonRow& row) {
             EXPECT_EQ(table, "");
             seen.push_back(row.Whole("a"));
             return row.status();
           });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_THAT(seen, ElementsAre(1, 2, 3));
}

TEST_F(JsonRowsTest, VisitsTheTablesThatAreNamedByRowOrByKey) {
  std::vector<std::string> seen;
  const absl::Status status =
      Read(R"({"version": "1.3", "other": {"k": [1]}, "edge": [2, 3], "node": [{"x": 1}, {"x": 2}],
               "paths": {"p": [{"x": 3}, {"x": 4}]}})",
           [&](std::string_view table, std::string_view key, const JsonRow& row) {
             std::string text = std::string(table) + "." + std::string(key) + ":";
             if (table == "node") text += std::to_string(row.Whole("x"));
             if (table == "paths") {
               for (const JsonRow& part : row.Elements()) text += std::to_string(part.Whole("x"));
             }
             seen.push_back(text);
             return row.status();
           });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_THAT(seen, ElementsAre("node.:1", "node.:2", "paths.p:34"));
}

TEST_F(JsonRowsTest, NamesTheFieldThatIsWrong) {
  const auto number = [](const JsonRow& row) { row.Number("x", 100.0); };
  EXPECT_EQ(Problem("{}", number), "rows.json[1].x: is missing");
  EXPECT_EQ(Problem("7", number), "rows.json[1]: must be an object");
  for (const char* wrong : {"null", "\"7\"", "[7]", "{}", "true", "101", "-1e300"}) {
    EXPECT_EQ(Problem(std::string("{\"x\": ") + wrong + "}", number),
              "rows.json[1].x: must be a number between -100 and 100");
  }
  const auto numbers = [](const JsonRow& row) { row.Numbers<2>("x", 100.0); };
  for (const char* wrong : {"3", "[1]", "[1, 2, 3]", "[1, null]", "[1, 1e9]"}) {
    EXPECT_THAT(Problem(std::string("{\"x\": ") + wrong + "}", numbers),
                HasSubstr("rows.json[1].x: must be 2 numbers"));
  }
  const auto whole = [](const JsonRow& row) { row.Whole("x"); };
  for (const char* wrong : {"1.5", "18446744073709551615", "\"1\""}) {
    EXPECT_EQ(Problem(std::string("{\"x\": ") + wrong + "}", whole),
              "rows.json[1].x: must be a whole number");
  }
  const auto text = [](const JsonRow& row) { row.Text("x"); };
  EXPECT_EQ(Problem(R"({"x": 3})", text), "rows.json[1].x: must be a text");
  EXPECT_EQ(Problem(R"({"x": ""})", text), "rows.json[1].x: is empty");
  const auto nested = [](const JsonRow& row) {
    for (const JsonRow& part : row.Rows("x")) part.Text("y");
  };
  EXPECT_EQ(Problem(R"({"x": [{"y": "a"}, {"y": 3}]})", nested),
            "rows.json[1].x[1].y: must be a text");
}

TEST_F(JsonRowsTest, SaysWhereAFileIsNotJson) {
  for (const char* wrong : {"", "[", "[{\"a\": 1}", "[{\"a\": NaN}]", "[{\"a\": 1e999}]", "[1] 2",
                            "[{\"a\": \"\xff\"}]", "[{\"a\" 1}]", "\x1f\x8b\x08"}) {
    const absl::Status status = Read(wrong);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << wrong;
    EXPECT_THAT(std::string(status.message()), HasSubstr("rows.json: no JSON at byte ")) << wrong;
  }
  EXPECT_EQ(Read("3").message(), "rows.json: must be an array or an object");
}

TEST_F(JsonRowsTest, EveryTruncationIsDataLoss) {
  const std::string whole = R"({"node": [{"x": 1.5, "y": [1, {"z": "t"}]}], "paths": {"a": [{}]}})";
  EXPECT_TRUE(Read(whole).ok());
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_EQ(Read(whole.substr(0, length)).code(), absl::StatusCode::kDataLoss) << length;
  }
}

TEST_F(JsonRowsTest, RefusesARowThatIsLargerThanAnyOfADataset) {
  std::string row = "[[";
  for (size_t i = 0; i < kMostValuesPerRow; ++i) row += "0,";
  EXPECT_THAT(std::string(Read(row + "0]]").message()), HasSubstr("rows.json: [0]: has more than"));
  // As deep as it is long: nothing here recurses.
  EXPECT_EQ(Read(std::string(200'000, '[')).code(), absl::StatusCode::kDataLoss);
}

TEST_F(JsonRowsTest, EndsWithTheErrorOfAVisit) {
  int rows = 0;
  const absl::Status status =
      Read("[{}, {}, {}]", [&](std::string_view, std::string_view, const JsonRow&) {
        return ++rows == 2 ? absl::CancelledError("enough") : absl::OkStatus();
      });
  EXPECT_EQ(status.message(), "enough");
  EXPECT_EQ(rows, 2);
}

}  // namespace
}  // namespace maneuver::data::json_rows_test
