#include "server/serving/version_uploads.h"

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <barrier>
#include <cerrno>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "model/files/digest.h"
#include "model/files/errno_status.h"
#include "server/serving/version_files.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/serving/serving_table_fixture.h"

namespace maneuver::serving::version_uploads_test {
namespace {

using ::testing::ElementsAre;

class VersionUploadsTest : public ServingTableTest {
 protected:
  void Open(ModelCheck check) {
    uploads_ = std::make_unique<VersionUploads>(folder_ / "models", *store_, *table_,
                                                std::chrono::hours(1), false, std::move(check));
  }

  // model.json, without its actions.
  static std::string Manifest() {
    v1::ModelManifest manifest = artifact::TinyModel().manifest;
    manifest.set_format_version(1);
    std::string json;
    EXPECT_TRUE(google::protobuf::util::MessageToJsonString(manifest, &json).ok());
    return json;
  }

  v1::UploadModelHeader Header() const {
    v1::UploadModelHeader header;
    for (const auto& [name, bytes] :
         {std::pair(kManifestFile, manifest_), {kWeightsFile, weights_}}) {
      v1::ModelFile& file = *header.add_files();
      file.set_file(name);
      file.set_size_bytes(static_cast<int64_t>(bytes.size()));
      file.set_sha256(files::Sha256Hex(bytes));
    }
    return header;
  }

  absl::StatusOr<v1::ModelVersion> Upload(const std::string& caller) {
    auto upload = uploads_->Begin("town", Header(), caller);
    if (!upload.ok()) return upload.status();
    if (absl::Status status = (*upload)->Append(manifest_ + weights_); !status.ok()) return status;
    return (*upload)->Commit();
  }

  const std::string manifest_ = Manifest();
  const std::string weights_ = "good";
  std::unique_ptr<VersionUploads> uploads_;
};

TEST_F(VersionUploadsTest, TheSameFilesFromTwoCallersAtOnceMakeOneVersion) {
  std::barrier both(2);
  Open([&both](const std::filesystem::path&) {
    both.arrive_and_wait();
    return absl::OkStatus();
  });
  absl::StatusOr<v1::ModelVersion> first;
  std::thread other([this, &first] { first = Upload("a"); });
  const auto second = Upload("b");
  other.join();
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(first->name(), second->name());
  EXPECT_EQ(store_->List("town").size(), 1u);
}

TEST_F(VersionUploadsTest, KeepsWhatHasArrivedIfTheServerCannotReadIt) {
  const absl::Status failed = files::ErrnoStatus(ESTALE, "read", "weights.safetensors");
  Open([&failed](const std::filesystem::path&) { return failed; });
  EXPECT_EQ(Upload("a").status(), failed);
  const auto arrived = uploads_->Query("town", Header().files(), "a");
  ASSERT_TRUE(arrived.ok()) << arrived.status();
  EXPECT_THAT(arrived->arrived_bytes(), ElementsAre(manifest_.size(), weights_.size()));
}

TEST_F(VersionUploadsTest, DiscardsFilesThatAreNoModel) {
  Open([](const std::filesystem::path&) { return absl::DataLossError("model.json is empty"); });
  const absl::Status status = Upload("a").status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(), "the files are not a model: model.json is empty");
  const auto arrived = uploads_->Query("town", Header().files(), "a");
  ASSERT_TRUE(arrived.ok()) << arrived.status();
  EXPECT_THAT(arrived->arrived_bytes(), ElementsAre(0, 0));
}

}  // namespace
}  // namespace maneuver::serving::version_uploads_test
