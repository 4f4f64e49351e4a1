#include "tests/durability/publication.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/durability/faulty_disk.h"

namespace maneuver::durability {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> TemporariesIn(const fs::path& folder) {
  std::vector<std::string> temporaries;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().filename().string().find(".tmp-") != std::string::npos) {
      temporaries.push_back(entry.path().lexically_relative(folder));
    }
  }
  return temporaries;
}

class Sweep {
 public:
  Sweep(const Publication& publication, const fs::path& parent)
      : publication_(publication), parent_(parent) {}

  int Moments() {
    const fs::path folder = NewFolder();
    Arm(folder);
    const absl::Status status = publication_.publish(folder);
    const int moments = Disarm();
    EXPECT_TRUE(status.ok()) << status;
    EXPECT_TRUE(publication_.is_new(folder));
    return moments;
  }

  // Lets an operation fail while the program continues.
  void Fail(Fault fault, int at) {
    const fs::path folder = NewFolder();
    Arm(folder, fault, at);
    const absl::Status status = publication_.publish(folder);
    Disarm();
    EXPECT_THAT(TemporariesIn(folder), testing::IsEmpty());
    const bool is_new = publication_.is_new(folder);
    if (status.ok()) {
      EXPECT_TRUE(is_new) << "it was acknowledged";
    } else {
      EXPECT_NE(status.message(), "");
    }
    if (!is_new) {
      const absl::Status again = publication_.publish(folder);
      EXPECT_TRUE(again.ok()) << again;
      EXPECT_TRUE(publication_.is_new(folder));
    }
  }

  // Ends the program at an operation. `acknowledged`: after the last one, once the publication was
  // acknowledged.
  void CutPowerAt(Fault fault, int at, bool acknowledged) {
    const fs::path folder = NewFolder();
    const pid_t child = fork();
    if (child == 0) {
      Arm(folder, fault, at);
      if (!publication_.publish(folder).ok()) _exit(1);
      CutPower();
    }
    int ended = 0;
    ASSERT_EQ(waitpid(child, &ended, 0), child);
    ASSERT_TRUE(WIFEXITED(ended));
    ASSERT_EQ(WEXITSTATUS(ended), kPowerCutStatus);
    const bool is_new = publication_.is_new(folder);
    if (acknowledged) {
      EXPECT_TRUE(is_new) << "it was acknowledged";
    }
    EXPECT_THAT(TemporariesIn(folder), testing::IsEmpty());
    if (!is_new) {
      const absl::Status again = publication_.publish(folder);
      EXPECT_TRUE(again.ok()) << again;
    }
  }

 private:
  fs::path NewFolder() {
    const fs::path folder = parent_ / std::to_string(next_++);
    fs::create_directories(folder);
    publication_.prepare(folder);
    return folder;
  }

  const Publication& publication_;
  const fs::path parent_;
  int next_ = 0;
};

}  // namespace

int CheckEveryFault(const Publication& publication, const fs::path& parent) {
  Sweep sweep(publication, parent);
  const int moments = sweep.Moments();
  for (int at = 0; at < moments; ++at) {
    SCOPED_TRACE(absl::StrCat("operation ", at, " of ", moments));
    {
      SCOPED_TRACE("fails");
      sweep.Fail(Fault::kError, at);
    }
    SCOPED_TRACE("finds the disk full");
    sweep.Fail(Fault::kFull, at);
  }
  for (int at = 0; at <= moments; ++at) {
    SCOPED_TRACE(absl::StrCat("the power goes at operation ", at, " of ", moments));
    {
      SCOPED_TRACE("names that were not synced are lost");
      sweep.CutPowerAt(Fault::kPowerCutNames, at, at == moments);
    }
    SCOPED_TRACE("names that were not synced are there");
    sweep.CutPowerAt(Fault::kPowerCut, at, at == moments);
  }
  return moments;
}

}  // namespace maneuver::durability
