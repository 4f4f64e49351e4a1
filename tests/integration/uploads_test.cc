// Tests uploads over a network that breaks, to a server that is killed, and by a client that is
// killed: bytes that arrived are not sent again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <future>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/client.h"
#include "model/data/dataset_folder.h"
#include "tests/integration/breaking_proxy.h"
#include "tests/integration/server_process.h"
#include "tests/unit/model/data/recordings_for_tests.h"

namespace maneuver::integration::uploads_test {
namespace {

using ::testing::HasSubstr;

constexpr int kRecordings = 40;
constexpr int kPointsPerRecording = 40'000;
constexpr int64_t kMegabyte = 1'000'000;
// The bytes that may be in transit when a connection breaks: Linux lets a socket's buffers grow to
// 4 MB at the sender and to 6 MB or more at the receiver, and a busy server leaves them full. This
// is less than what these tests send before the break, which an upload that started again would
// send twice.
constexpr int64_t kInFlight = 12 * kMegabyte;

class UploadsTest : public ::testing::Test {
 protected:
  UploadsTest() : server_(StartServer()) {
    // An incompressible map makes recordings large.
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> anywhere(-1e3, 1e3);
    auto writer = data::DatasetWriter::Create(local(), "a test", {.shard_bytes = 4 * kMegabyte});
    for (int i = 0; i < kRecordings; ++i) {
      v1::Scenario recording = data::SmallRecording(absl::StrCat("r", i));
      for (int j = 0; j < kPointsPerRecording; ++j) {
        recording.mutable_map_features(0)->add_x(anywhere(random));
        recording.mutable_map_features(0)->add_y(anywhere(random));
      }
      EXPECT_TRUE((*writer)->Add(recording).ok());
    }
    const auto dataset = (*writer)->Commit();
    EXPECT_TRUE(dataset.ok()) << dataset.status();
    for (const v1::Shard& shard : dataset->shards()) size_ += shard.size_bytes();
  }

  std::filesystem::path local() const { return folder_.path() / "local"; }
  std::filesystem::path data() const { return folder_.path() / "data"; }
  std::unique_ptr<ServerProcess> StartServer() const {
    std::filesystem::create_directories(data());
    return std::make_unique<ServerProcess>(data());
  }

  absl::StatusOr<v1::Dataset> Upload(const BreakingProxy& proxy) const {
    const auto client = client::Client::Connect({.address = proxy.address()});
    return (*client)->UploadDataset(local(), "datasets/big", nullptr);
  }

  void ExpectThatItIsThere() const {
    const absl::Status whole = data::VerifyDatasetFolder(data() / "datasets" / "big");
    EXPECT_TRUE(whole.ok()) << whole;
    EXPECT_FALSE(std::filesystem::exists(data() / "datasets" / ".uploads"));
  }

  const TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> server_;
  int64_t size_ = 0;
};

TEST_F(UploadsTest, AnUploadContinuesAfterItsConnectionBreaks) {
  std::atomic<int> breaks = 0;
  const BreakingProxy proxy(server_->address(), [&](int64_t sent) {
    const bool breaks_now = breaks < 2 && sent > (breaks + 1) * 10 * kMegabyte;
    breaks += breaks_now ? 1 : 0;
    return breaks_now;
  });
  const auto dataset = Upload(proxy);
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_EQ(breaks, 2);
  EXPECT_GE(proxy.connections(), 3);
  EXPECT_GT(proxy.sent(), size_);
  EXPECT_LT(proxy.sent(), size_ + 2 * kInFlight);
  RecordProperty("dataset_bytes", absl::StrCat(size_));
  RecordProperty("sent_bytes", absl::StrCat(proxy.sent()));
  ExpectThatItIsThere();
}

TEST_F(UploadsTest, AnUploadContinuesAfterTheServerWasKilled) {
  std::atomic<bool> killed = false;
  std::promise<void> half_way;
  BreakingProxy proxy(server_->address(), [&](int64_t sent) {
    if (sent < 15 * kMegabyte || killed.exchange(true)) return false;
    server_->Kill();
    half_way.set_value();
    return true;
  });
  auto upload = std::async(std::launch::async, [&] { return Upload(proxy); });
  ASSERT_EQ(half_way.get_future().wait_for(std::chrono::seconds(60)), std::future_status::ready);
  server_ = StartServer();
  proxy.SetServer(server_->address());
  const auto dataset = upload.get();
  ASSERT_TRUE(dataset.ok()) << dataset.status();
  EXPECT_LT(proxy.sent(), size_ + kInFlight);
  RecordProperty("dataset_bytes", absl::StrCat(size_));
  RecordProperty("sent_bytes", absl::StrCat(proxy.sent()));
  ExpectThatItIsThere();
}

TEST_F(UploadsTest, RepeatingAKilledCommandContinuesItsUpload) {
  std::unique_ptr<ChildProcess> command;
  std::mutex mutex;
  const BreakingProxy proxy(server_->address(), [&](int64_t sent) {
    const std::lock_guard lock(mutex);
    if (sent < 15 * kMegabyte || command == nullptr) return false;
    command->Signal(SIGKILL);
    return true;
  });
  const std::vector<std::string> upload = {
      MANEUVER, "--server", proxy.address(), "dataset", "upload", local(), "big"};
  {
    const std::lock_guard lock(mutex);
    command = std::make_unique<ChildProcess>(upload, folder_.path() / "log");
  }
  EXPECT_EQ(command->Wait(std::chrono::seconds(60)), 128 + SIGKILL);
  {
    const std::lock_guard lock(mutex);
    command.reset();
  }
  // The server may still be working on some of the bytes.
  std::string output;
  EXPECT_EQ(integration::Run(upload, &output), 0) << output;
  EXPECT_THAT(output, HasSubstr("resumed: "));
  EXPECT_THAT(output, HasSubstr(" were there"));
  EXPECT_THAT(output, HasSubstr("datasets/big: 40 recordings"));
  EXPECT_LT(proxy.sent(), size_ + kInFlight);
  RecordProperty("dataset_bytes", absl::StrCat(size_));
  RecordProperty("sent_bytes", absl::StrCat(proxy.sent()));
  ExpectThatItIsThere();
}

}  // namespace
}  // namespace maneuver::integration::uploads_test
