#include "server/monitoring/logging.h"

#include <gtest/gtest.h>

#include <limits>

namespace maneuver::monitoring::logging_test {
namespace {

TEST(LoggingTest, QuotesOnlyTextThatNeedsIt) {
  EXPECT_EQ(FormatLogLine(LogFormat::kText, "model loaded",
                          {{"name", "models/town"},
                           {"why", "two words"},
                           {"empty", ""},
                           {"n", 3},
                           {"s", 0.25},
                           {"ok", true}}),
            "model loaded name=models/town why=\"two words\" empty=\"\" n=3 s=0.25 ok=true");
}

TEST(LoggingTest, FieldsCannotForgeALine) {
  EXPECT_EQ(FormatLogLine(LogFormat::kText, "x", {{"k", "a\nb=\"c\""}}), "x k=\"a\\nb=\\\"c\\\"\"");
  EXPECT_EQ(FormatLogLine(LogFormat::kJson, "x", {{"k", "a\nb\"\x01"}}),
            "\"message\":\"x\",\"k\":\"a\\nb\\\"\\u0001\"");
}

// What a library logs may be no UTF-8, and then no JSON.
TEST(LoggingTest, WritesUtf8AndEscapesWhatIsNot) {
  EXPECT_EQ(FormatLogLine(LogFormat::kJson, "x", {{"k", "B\xc3\xbcro \xff\xc3(\xc2"}}),
            "\"message\":\"x\",\"k\":\"B\xc3\xbcro \\ufffd\\ufffd(\\ufffd\"");
}

TEST(LoggingTest, EscapesWhatTerminalsTakeForCommands) {
  EXPECT_EQ(FormatLogLine(LogFormat::kText, "x", {{"k", "a\x7f\xc2\x9b"}}),
            "x k=\"a\\u007f\\u009b\"");
}

TEST(LoggingTest, JsonWritesNanAsNull) {
  EXPECT_EQ(FormatLogLine(LogFormat::kJson, "x",
                          {{"k", std::numeric_limits<double>::quiet_NaN()}, {"b", false}}),
            "\"message\":\"x\",\"k\":null,\"b\":false");
}

}  // namespace
}  // namespace maneuver::monitoring::logging_test
