// Tags datasets as jobs of a real server that is killed meanwhile, and compares every byte with
// what maneuver tag writes.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/client.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/artifact/model_folder.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/integration/trained_server.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::tagging_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kDatasets = 4;  // of one shard each

// Every file that belongs to tags.
std::map<std::string, std::string> Contents(const fs::path& folder) {
  std::map<std::string, std::string> contents;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.front() != '.') contents[name] = files::ReadFile(entry.path()).value_or("");
  }
  return contents;
}

class TaggingTest : public ::testing::Test {
 protected:
  TaggingTest() {
    fs::create_directories(data() / "models" / "small");
    const auto written = artifact::WriteModelFolder(
        data() / "models" / "small" / "1",
        inference::RandomModel(artifact::TinyModel().manifest.spec(), 1));
    EXPECT_TRUE(written.ok()) << written;
    Restart();
    for (int i = 0; i < kDatasets; ++i) {
      const std::string name = absl::StrCat("d", i);
      const fs::path folder = folder_.path() / name;
      WriteTown(folder, static_cast<uint64_t>(i), 6, nullptr);
      Run({"dataset", "upload", folder.string(), name});
      names_.push_back(name);
      folders_.push_back(folder.string());
    }
  }

  fs::path data() const { return folder_.path() / "data"; }
  void Restart() {
    server_.reset();
    server_ = std::make_unique<ServerProcess>(data());
  }
  std::string Run(const std::vector<std::string>& command, int status = 0) {
    std::string output;
    EXPECT_EQ(RunManeuver(*server_, command, &output), status) << output;
    return output;
  }
  // Tags the server's datasets in a job.
  std::vector<std::string> OnServer(const std::string& name,
                                    const std::vector<std::string>& more = {}) const {
    std::vector<std::string> command = {"tag"};
    command.insert(command.end(), names_.begin(), names_.end());
    command.insert(command.end(), {"--model", "small/1", "--on-server", name});
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  // Returns what maneuver tag writes.
  std::map<std::string, std::string> Local() {
    std::vector<std::string> command = {"tag"};
    command.insert(command.end(), folders_.begin(), folders_.end());
    const std::string output = (folder_.path() / "local").string();
    command.insert(command.end(), {"--model", (data() / "models/small/1").string(), "-o", output});
    Run(command);
    return Contents(output);
  }

  TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> server_;
  std::vector<std::string> names_;
  std::vector<std::string> folders_;
};

TEST_F(TaggingTest, WritesTheBytesOfManeuverTagEvenIfTheServerIsKilled) {
  v1::Job job;
  const std::string detached = Run(OnServer("june", {"--detach", "--output", "json"}));
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(detached, &job).ok()) << detached;
  // Once a shard is there. The others may be, too.
  const fs::path first = data() / "tags" / "june" / "d0-scenarios-00000.tags";
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(120);
  while (!fs::exists(first)) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const auto written = fs::last_write_time(first);
  server_->Kill();
  Restart();
  EXPECT_THAT(Run({"job", "watch", job.name()}), HasSubstr("4 of 4 shards"));
  EXPECT_EQ(fs::last_write_time(first), written) << "a complete shard is not written again";
  const std::map<std::string, std::string> local = Local();
  EXPECT_EQ(local.size(), 2u * kDatasets + 1u);
  EXPECT_EQ(Contents(data() / "tags" / "june"), local);
  EXPECT_THAT(Run({"job", "list"}), ContainsRegex("tag +small/1 +succeeded"));

  // Parts complete each other.
  Run(OnServer("july", {"--shards", "0/2"}));
  EXPECT_THAT(Run({"tags", "show", "july"}), HasSubstr("2 of 4"));
  Run(OnServer("july", {"--shards", "1/2"}));
  EXPECT_EQ(Contents(data() / "tags" / "july"), local);
  EXPECT_THAT(Run({"tags", "list"}), ContainsRegex("july +small/1 +.*4 of 4"));

  // By the command and by the library.
  const std::string pulled = (folder_.path() / "pulled").string();
  EXPECT_THAT(Run({"tags", "pull", "june", pulled}), HasSubstr("tags/june"));
  EXPECT_EQ(Contents(pulled), local);
  EXPECT_THAT(Run({"find", pulled, "--by", "dataset"}), HasSubstr("d3"));
  Run({"tags", "pull", "june", pulled});  // nothing is missing
  EXPECT_THAT(Run({"tags", "pull", "june", folders_[0]}, 1), HasSubstr("name another folder"));
  const auto client = client::Client::Connect({.address = server_->address()});
  ASSERT_TRUE(client.ok()) << client.status();
  const std::string again = (folder_.path() / "again").string();
  const auto name = (*client)->DownloadTags("tags/june", again, {});
  ASSERT_TRUE(name.ok()) << name.status();
  EXPECT_EQ(*name, "tags/june");
  EXPECT_EQ(Contents(again), local);

  Run({"tags", "delete", "june"});
  EXPECT_FALSE(fs::exists(data() / "tags" / "june"));
  EXPECT_THAT(Run({"tags", "show", "june"}, 1), HasSubstr("there are no tags/june"));
  EXPECT_THAT(Run({"tags", "list"}), Not(HasSubstr("june")));
  EXPECT_THAT(Run(OnServer("july", {"--windows"}), 1), HasSubstr("another windows"));
}

TEST_F(TaggingTest, ADownloadTakesWhatAnEarlierOneLeft) {
  Run(OnServer("june"));
  const fs::path there = data() / "tags" / "june";
  const std::string schema = files::ReadFile(there / "schema.json").value_or("");
  const fs::path part = folder_.path() / ".pulled.part";
  fs::create_directory(part);
  ASSERT_TRUE(
      files::WriteFileAtomically(part / files::Sha256Hex(schema), schema.substr(0, 1'000)).ok());
  const auto client = client::Client::Connect({.address = server_->address()});
  ASSERT_TRUE(client.ok()) << client.status();
  int64_t resumed = 0;
  const auto name = (*client)->DownloadTags(
      "tags/june", (folder_.path() / "pulled").string(),
      [&](const client::UploadProgress& progress) { resumed = progress.resumed; });
  ASSERT_TRUE(name.ok()) << name.status();
  EXPECT_EQ(resumed, 1'000);
  EXPECT_EQ(Contents(folder_.path() / "pulled"), Contents(there));
}

}  // namespace
}  // namespace maneuver::integration::tagging_test
