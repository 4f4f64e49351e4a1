#include "server/maneuverd/configuration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maneuver::configuration_test {
namespace {

using ::testing::HasSubstr;

std::string Error(std::string_view text) {
  return std::string(ParseSettings(text, "m.conf").status().message());
}

TEST(SettingsFileTest, AcceptsBareAndQuotedValuesAndComments) {
  const auto settings = ParseSettings(
      "# a comment\n"
      "\n"
      "max-batch = 32   # why\n"
      "  tokens=/etc/tokens\r\n"
      "data-dir = \"/a \\\"b\\\" \\\\ # c\"  # d",
      "m.conf");
  ASSERT_TRUE(settings.ok()) << settings.status();
  ASSERT_EQ(settings->size(), 3u);
  EXPECT_EQ((*settings)[0].name, "max-batch");
  EXPECT_EQ((*settings)[0].value, "32");
  EXPECT_EQ((*settings)[0].source, "m.conf:3");
  EXPECT_EQ((*settings)[1].value, "/etc/tokens");
  EXPECT_EQ((*settings)[2].value, "/a \"b\" \\ # c");
  EXPECT_EQ((*settings)[2].source, "m.conf:5");
}

TEST(SettingsFileTest, NamesTheLineThatItCannotRead) {
  for (const char* line :
       {"max-batch", "= 3", "max-batch =", "max_batch = 3", "[section]", "max-batch = 3 4",
        "a = \"b", "a = \"b\" c", "a = \"\\x\"", "a = b\"c\"", "a = # no value"}) {
    EXPECT_THAT(Error("workers = 1\n" + std::string(line) + "\n"), HasSubstr("m.conf:2: ")) << line;
  }
}

TEST(SettingsFileTest, RefusesARepeatedName) {
  EXPECT_EQ(Error("workers = 1\n\nworkers = 2\n"), "m.conf:3: workers is set in line 1 too");
}

}  // namespace
}  // namespace maneuver::configuration_test
