#include "server/errors/reasons.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/errors/error_details.h"

namespace maneuver::errors::reasons_test {
namespace {

namespace fs = std::filesystem;

const fs::path kSources = MANEUVER_SOURCES;

std::string Read(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

TEST(ReasonsTest, TheErrorsPageMatchesTheTable) {
  std::vector<std::string> rows;
  for (const ReasonEntry& entry : kReasons) {
    rows.push_back(absl::StrCat("| `", View(entry.name), "` | ", View(entry.codes), " | ",
                                View(entry.meaning), " | ", View(entry.remedy), " |"));
  }
  std::vector<std::string> page;
  for (const absl::string_view line :
       absl::StrSplit(Read(kSources / "docs/reference/errors.md"), '\n')) {
    if (line.substr(0, 3) == "| `") page.emplace_back(line);
  }
  EXPECT_THAT(page, ::testing::ElementsAreArray(rows));
}

TEST(ReasonsTest, NamesAreUpperSnakeCaseAndUnique) {
  std::set<std::string_view> names;
  for (const ReasonEntry& entry : kReasons) {
    EXPECT_THAT(std::string(entry.name), ::testing::MatchesRegex("[A-Z]+(_[A-Z]+)*"));
    EXPECT_TRUE(names.insert(entry.name).second) << entry.name;
  }
}

TEST(ReasonsTest, CodesAreCanonical) {
  std::set<std::string> canonical = {"any"};
  for (int code = 1; code <= 16; ++code) {
    canonical.insert(absl::StatusCodeToString(static_cast<absl::StatusCode>(code)));
  }
  for (const ReasonEntry& entry : kReasons) {
    for (const absl::string_view code : absl::StrSplit(View(entry.codes), ", ")) {
      EXPECT_TRUE(canonical.contains(std::string(code))) << entry.name << ": " << code;
    }
  }
}

// The compiler checks the converse.
TEST(ReasonsTest, EveryReasonIsUsedInTheCode) {
  std::string sources;
  for (const auto& file : fs::recursive_directory_iterator(kSources / "server")) {
    const fs::path path = file.path();
    if (path.filename() == "reasons.h") continue;
    if (path.extension() == ".cc" || path.extension() == ".h") sources += Read(path);
  }
  for (const ReasonEntry& entry : kReasons) {
    EXPECT_NE(sources.find(absl::StrCat("\"", View(entry.name), "\"")), std::string::npos)
        << entry.name;
  }
}

TEST(ReasonsTest, AnErrorCarriesItsReason) {
  EXPECT_EQ(ReasonOf(WithReason(absl::NotFoundError("none"), "JOB_NOT_FOUND")), "JOB_NOT_FOUND");
}

}  // namespace
}  // namespace maneuver::errors::reasons_test
