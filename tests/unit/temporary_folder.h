// An empty folder of a test's own, removed with it.

#ifndef MANEUVER_TESTS_UNIT_TEMPORARY_FOLDER_H_
#define MANEUVER_TESTS_UNIT_TEMPORARY_FOLDER_H_

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <vector>

namespace maneuver {

// Make it while a test runs: in its body, or as a member of its fixture, before the members that
// use it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    static int made = 0;
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    // Tests run side by side, each in a process of its own. Suites and tests of parameters have
    // slashes in their names.
    std::string name = std::string("maneuver-") + test->test_suite_name() + "-" + test->name() +
                       "-" + std::to_string(getpid()) + "-" + std::to_string(made++);
    std::replace(name.begin(), name.end(), '/', '-');
    path_ = std::filesystem::path(::testing::TempDir()) / name;
    std::filesystem::remove_all(path_);
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;  // somebody may still write there: no reason to end the program
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::filesystem::path& name) const { return path_ / name; }

  // Returns the names of what is in it, hidden or not.
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(path_)) {
      names.push_back(entry.path().filename());
    }
    return names;
  }

 private:
  std::filesystem::path path_;
};

inline void WriteBytes(const std::filesystem::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

}  // namespace maneuver

#endif  // MANEUVER_TESTS_UNIT_TEMPORARY_FOLDER_H_
