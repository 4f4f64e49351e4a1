#include "tests/durability/corruption.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

#include "tests/unit/temporary_folder.h"

namespace maneuver::durability {
namespace {

namespace fs = std::filesystem;

constexpr std::array<char, 3> kFlips = {'\x01', '\x20', '\xff'};
constexpr size_t kLargeFile = 1000;
constexpr size_t kStride = 61;

std::string ReadBytes(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::map<fs::path, std::string> Contents(const fs::path& folder) {
  std::map<fs::path, std::string> contents;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) contents[entry.path()] = ReadBytes(entry.path());
  }
  return contents;
}

// A reader may have mended a file, or added one.
void Restore(const fs::path& folder, const std::map<fs::path, std::string>& contents) {
  for (const auto& [file, now] : Contents(folder)) {
    const auto before = contents.find(file);
    if (before == contents.end()) {
      fs::remove(file);
    } else if (before->second != now) {
      WriteBytes(file, before->second);
    }
  }
  for (const auto& [file, content] : contents) {
    if (!fs::exists(file)) WriteBytes(file, content);
  }
}

// Returns where two answers begin to differ, and some of what the first has there.
std::string FirstDifference(const std::string& answer, const std::string& whole) {
  const auto at = std::mismatch(answer.begin(), answer.end(), whole.begin(), whole.end()).first;
  const auto place = static_cast<size_t>(at - answer.begin());
  return "at " + std::to_string(place) + " \"" +
         answer.substr(place - std::min(place, size_t{20}), 60) + "\"";
}

}  // namespace

void ExpectNoSilentDamage(const fs::path& folder, const ReadAll& read,
                          const std::vector<std::string>& also,
                          const std::vector<FilePart>& parts) {
  const bool every_byte = std::getenv("MANEUVER_EVERY_BYTE") != nullptr;
  const auto contents = Contents(folder);
  const absl::StatusOr<std::string> whole = read(folder);
  ASSERT_TRUE(whole.ok()) << whole.status();
  Restore(folder, contents);
  int refused = 0;
  int same = 0;
  int silent = 0;
  std::vector<FilePart> flipped = parts;
  for (const auto& [file, content] : contents) {
    if (parts.empty()) flipped.push_back({file, 0, content.size()});
  }
  for (const auto& [file, begin, end] : flipped) {
    const std::string& content = contents.at(file);
    const bool each = every_byte || !parts.empty() || content.size() <= kLargeFile;
    const size_t stride = each ? 1 : kStride;
    for (size_t at = begin; at < end; at += stride) {
      for (size_t flip = 0; flip < kFlips.size(); ++flip) {
        if (!every_byte && flip != at / stride % kFlips.size()) continue;
        std::string damaged = content;
        damaged[at] ^= kFlips[flip];
        WriteBytes(file, damaged);
        const absl::StatusOr<std::string> answer = read(folder);
        Restore(folder, contents);
        if (!answer.ok()) {
          EXPECT_FALSE(answer.status().message().empty());
          ++refused;
        } else if (*answer == *whole || std::ranges::find(also, *answer) != also.end()) {
          ++same;
        } else if (++silent <= 5) {
          ADD_FAILURE() << file.filename() << ", byte " << at << ", flipped by "
                        << (kFlips[flip] & 0xff) << ": another answer, and no error; it has "
                        << FirstDifference(*answer, *whole);
        }
      }
    }
  }
  EXPECT_EQ(silent, 0);
  EXPECT_TRUE(refused > 0 || !also.empty());
  ::testing::Test::RecordProperty("refused", refused);
  ::testing::Test::RecordProperty("same", same);
  std::printf("%d flips refused, %d without effect, %d silent\n", refused, same, silent);
}

}  // namespace maneuver::durability
