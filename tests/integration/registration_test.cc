// Datasets in place on the server's disk, by the command: learned from, noticed when they change,
// and left alone by a deletion.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "model/data/dataset_folder.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::registration_test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class RegistrationTest : public ::testing::Test {
 protected:
  RegistrationTest() {
    fs::create_directories(volume_);
    fs::create_directories(folder_.path() / "data");
    WriteTown(volume_ / "town", 1, 60, nullptr);
    std::ofstream(folder_.path() / "tiny.json") << kTinySettings;
    server_ = std::make_unique<ServerProcess>(
        folder_.path() / "data", std::vector<std::string>{"--dataset-folders", volume_.string()});
  }

  std::string Run(const std::vector<std::string>& command, int status = 0) {
    std::string output;
    EXPECT_EQ(RunManeuver(*server_, command, &output), status) << output;
    return output;
  }

  std::vector<std::string> Train() const {
    return {"train",      "tiny",
            "--dataset",  "town",
            "--settings", (folder_.path() / "tiny.json").string(),
            "--set",      "optimization.pretraining_epochs=1",
            "--set",      "optimization.mixture_epochs=1",
            "--set",      "optimization.joint_epochs=1"};
  }

  const TemporaryFolder folder_;
  const fs::path volume_ = folder_.path() / "volume";
  std::unique_ptr<ServerProcess> server_;
};

TEST_F(RegistrationTest, ADatasetInPlaceIsUsedLikeOthersAndNoticedWhenItChanges) {
  const fs::path town = volume_ / "town";
  EXPECT_THAT(Run({"dataset", "register", "town", town.string()}),
              AllOf(HasSubstr("datasets/town: 60 recordings"), HasSubstr(town.string())));
  EXPECT_THAT(Run({"dataset", "show", "town"}), HasSubstr("in place: " + town.string()));
  EXPECT_THAT(Run([&] {
                std::vector<std::string> command = Train();
                command.emplace_back("--validate-only");
                return command;
              }()),
              HasSubstr("of recordings, all of them at once"));
  Run(Train());

  const std::string shard = data::ReadDatasetManifest(town)->shards(0).file();
  std::fstream(town / shard, std::ios::in | std::ios::out).seekp(1'000).write("changed", 7);
  EXPECT_THAT(Run({"dataset", "show", "town"}, 1),
              AllOf(HasSubstr(shard), HasSubstr("has changed since it was registered")));
  EXPECT_THAT(Run(Train(), 1), HasSubstr(shard));

  Run({"dataset", "delete", "town"});
  EXPECT_TRUE(fs::exists(town / shard));
  EXPECT_TRUE(fs::exists(town / "dataset.json"));
}

TEST_F(RegistrationTest, FoldersElsewhereAreRefused) {
  WriteTown(folder_.path() / "elsewhere", 1, 1, nullptr);
  fs::create_directory_symlink(folder_.path() / "elsewhere", volume_ / "link");
  for (const fs::path& folder :
       {folder_.path() / "elsewhere", volume_ / ".." / "elsewhere", volume_ / "link"}) {
    EXPECT_THAT(Run({"dataset", "register", "stolen", folder.string()}, 1),
                HasSubstr("does not lie in a folder that --dataset-folders names"));
  }
  EXPECT_THAT(Run({"dataset", "register", "town", "town"}, 1), HasSubstr("absolute path"));
}

}  // namespace
}  // namespace maneuver::integration::registration_test
