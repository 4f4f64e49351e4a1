// Tests transfers of versions from one server to another: complete, damaged, hostile, interrupted
// and repeated ones.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/client.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "model/artifact/model_folder.h"
#include "model/files/digest.h"
#include "model/files/durable_file.h"
#include "tests/integration/raw_call.h"
#include "tests/integration/server_process.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::transfers_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kManifest[] = "model.json";
constexpr char kWeights[] = "weights.safetensors";

std::string Bytes(const fs::path& file) { return files::ReadFile(file).value_or("cannot be read"); }

class TransfersTest : public ::testing::Test {
 protected:
  TransfersTest() {
    fs::create_directories(data("a") / "models" / "town");
    fs::create_directories(data("b"));
    WriteModel(data("a") / "models" / "town" / "1", 1);
    a_ = std::make_unique<ServerProcess>(data("a"));
    b_ = std::make_unique<ServerProcess>(data("b"));
    stub_ = v1::ModelService::NewStub(b_->channel());
  }

  fs::path data(const std::string& server) const { return folder_.path() / server; }
  static void WriteModel(const fs::path& folder, int seed) {
    const auto written = artifact::WriteModelFolder(
        folder, inference::RandomModel(artifact::TinyModel().manifest.spec(), seed));
    ASSERT_TRUE(written.ok()) << written;
  }

  static std::unique_ptr<client::Client> Connect(const ServerProcess& server) {
    auto client = client::Client::Connect({.address = server.address()});
    EXPECT_TRUE(client.ok()) << client.status();
    return *std::move(client);
  }

  // Returns an upload header for the files of a folder.
  static v1::UploadModelHeader HeaderOf(const fs::path& folder) {
    v1::UploadModelHeader header;
    header.set_parent("models/town");
    for (const char* name : {kManifest, kWeights}) {
      v1::ModelFile* file = header.add_files();
      file->set_file(name);
      file->set_size_bytes(static_cast<int64_t>(fs::file_size(folder / name)));
      file->set_sha256(*files::Sha256OfFile(folder / name));
    }
    return header;
  }

  // Makes one UploadModelVersion call to `b_`, which ends after the last chunk.
  grpc::Status Upload(const v1::UploadModelHeader& header, const std::vector<std::string>& chunks) {
    grpc::ClientContext context;
    v1::ModelVersion version;
    const auto writer = stub_->UploadModelVersion(&context, &version);
    v1::UploadModelVersionRequest message;
    *message.mutable_header() = header;
    bool more = writer->Write(message);
    for (const std::string& chunk : chunks) {
      message.set_chunk(chunk);
      more = more && writer->Write(message);
    }
    writer->WritesDone();
    return writer->Finish();
  }

  v1::QueryModelUploadResponse Query(const v1::UploadModelHeader& header) {
    grpc::ClientContext context;
    v1::QueryModelUploadRequest request;
    request.set_parent(header.parent());
    *request.mutable_files() = header.files();
    v1::QueryModelUploadResponse response;
    const grpc::Status status = stub_->QueryModelUpload(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response;
  }

  // Returns the names of b's versions.
  std::vector<std::string> Versions() {
    v1::ListModelVersionsRequest request;
    request.set_parent("models/-");
    const auto listed = Connect(*b_)->ListModelVersions(request);
    EXPECT_TRUE(listed.ok()) << listed.status();
    std::vector<std::string> names;
    for (const v1::ModelVersion& version : listed->model_versions()) {
      names.push_back(version.name());
    }
    return names;
  }
  // Returns the entries of b's folder of models, hidden ones included.
  std::vector<std::string> Entries() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::recursive_directory_iterator(data("b") / "models")) {
      if (!entry.is_directory()) names.push_back(entry.path().filename().string());
    }
    return names;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> a_;
  std::unique_ptr<ServerProcess> b_;
  std::unique_ptr<v1::ModelService::Stub> stub_;
};

TEST_F(TransfersTest, AVersionMovesFromOneServerToAnother) {
  std::string output;
  const std::string pulled = (folder_.path() / "pulled").string();
  ASSERT_EQ(RunManeuver(*a_, {"model", "pull", "town/1", pulled}, &output), 0) << output;
  EXPECT_THAT(output, HasSubstr("is town/1"));
  for (const char* name : {kManifest, kWeights}) {
    EXPECT_EQ(Bytes(fs::path(pulled) / name), Bytes(data("a") / "models" / "town" / "1" / name));
  }
  ASSERT_EQ(RunManeuver(*b_, {"model", "push", pulled, "city"}, &output), 0) << output;
  EXPECT_THAT(output, HasSubstr("city/1\n"));
  EXPECT_THAT(output, HasSubstr("maneuver model promote city/1"));
  for (const char* name : {kManifest, kWeights}) {
    EXPECT_EQ(Bytes(data("b") / "models" / "city" / "1" / name), Bytes(fs::path(pulled) / name));
  }
  // The version serves only once it is promoted.
  EXPECT_EQ(RunManeuver(*b_, {"health", "maneuver.v1.PredictionService"}, &output), 1) << output;
  ASSERT_EQ(RunManeuver(*b_, {"model", "promote", "city/1"}, &output), 0) << output;
  EXPECT_EQ(RunManeuver(*b_, {"health", "maneuver.v1.PredictionService"}, &output), 0) << output;
  EXPECT_FALSE(fs::exists(data("b") / "models" / ".uploads"));
}

TEST_F(TransfersTest, RepeatingATransferCreatesNoSecondVersion) {
  const fs::path source = data("a") / "models" / "town" / "1";
  const auto client = Connect(*b_);
  const auto first = client->UploadModelVersion(source, "models/town", nullptr);
  const auto second = client->UploadModelVersion(source, "models/town", nullptr);
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_TRUE(second.ok()) << second.status();
  EXPECT_EQ(second->name(), "models/town/versions/1");
  // The same holds for a client that does not ask first which bytes exist.
  EXPECT_TRUE(Upload(HeaderOf(source), {Bytes(source / kManifest), Bytes(source / kWeights)}).ok());
  EXPECT_THAT(Versions(), ElementsAre("models/town/versions/1"));
  // The server that the version came from already has it as well, and serves it.
  std::string output;
  ASSERT_EQ(RunManeuver(*a_, {"model", "promote", "town/1"}, &output), 0) << output;
  const auto back = Connect(*a_)->UploadModelVersion(source, "models/town", nullptr);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->name(), "models/town/versions/1");
  EXPECT_THAT(back->aliases(), ElementsAre("serving"));
  EXPECT_EQ(RunManeuver(*a_, {"model", "push", source, "town"}, &output), 0);
  EXPECT_EQ(output, "town/1\n");

  const fs::path pulled = folder_.path() / "pulled";
  for (int i = 0; i < 2; ++i) {
    const auto version = client->DownloadModelVersion("models/town/versions/1", pulled, nullptr);
    ASSERT_TRUE(version.ok()) << version.status();
    EXPECT_EQ(*version, "models/town/versions/1");
  }
}

TEST_F(TransfersTest, AnUploadContinuesWhereItBrokeOff) {
  const fs::path source = data("a") / "models" / "town" / "1";
  const std::string manifest = Bytes(source / kManifest);
  const std::string weights = Bytes(source / kWeights);
  const v1::UploadModelHeader header = HeaderOf(source);
  const auto half = static_cast<int64_t>(weights.size() / 2);
  EXPECT_FALSE(Upload(header, {manifest, weights.substr(0, weights.size() / 2)}).ok());
  EXPECT_THAT(Query(header).arrived_bytes(),
              ElementsAre(static_cast<int64_t>(manifest.size()), half));
  EXPECT_THAT(Versions(), IsEmpty());
  client::UploadProgress first;
  const auto version = Connect(*b_)->UploadModelVersion(
      source, "models/town", [&](const client::UploadProgress& progress) {
        if (first.total == 0) first = progress;
      });
  ASSERT_TRUE(version.ok()) << version.status();
  EXPECT_EQ(first.resumed, static_cast<int64_t>(manifest.size()) + half);
  EXPECT_EQ(Bytes(data("b") / "models" / "town" / "1" / kWeights), weights);
}

TEST_F(TransfersTest, ADownloadContinuesWhereItBrokeOff) {
  const fs::path source = data("a") / "models" / "town" / "1";
  const std::string weights = Bytes(source / kWeights);
  const fs::path part = folder_.path() / ".pulled.part";
  fs::create_directory(part);
  std::ofstream(part / *files::Sha256OfFile(source / kWeights))
      << weights.substr(0, weights.size() / 3);
  std::ofstream(part / std::string(64, '0')) << "of another version";
  int64_t resumed = 0;
  const auto version = Connect(*a_)->DownloadModelVersion(
      "models/town/versions/1", folder_.path() / "pulled",
      [&](const client::UploadProgress& progress) { resumed = progress.resumed; });
  ASSERT_TRUE(version.ok()) << version.status();
  EXPECT_EQ(resumed, static_cast<int64_t>(weights.size() / 3));
  EXPECT_EQ(Bytes(folder_.path() / "pulled" / kWeights), weights);
  EXPECT_FALSE(fs::exists(part));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path() / "pulled"), {}), 2);
}

TEST_F(TransfersTest, DiscardsAWrongPartialDownloadAndFetchesItAgain) {
  const fs::path source = data("a") / "models" / "town" / "1";
  const fs::path part = folder_.path() / ".pulled.part";
  fs::create_directory(part);
  std::ofstream(part / *files::Sha256OfFile(source / kWeights)) << "these are not its first bytes";
  const auto version = Connect(*a_)->DownloadModelVersion("models/town/versions/1",
                                                          folder_.path() / "pulled", nullptr);
  ASSERT_TRUE(version.ok()) << version.status();
  EXPECT_EQ(Bytes(folder_.path() / "pulled" / kWeights), Bytes(source / kWeights));
}

TEST_F(TransfersTest, DownloadingADamagedVersionCreatesNoFolder) {
  const fs::path weights = data("a") / "models" / "town" / "1" / kWeights;
  std::string bytes = Bytes(weights);
  bytes.back() = static_cast<char>(bytes.back() ^ 1);
  std::ofstream(weights) << bytes;
  const auto version = Connect(*a_)->DownloadModelVersion("models/town/versions/1",
                                                          folder_.path() / "pulled", nullptr);
  EXPECT_TRUE(absl::IsDataLoss(version.status())) << version.status();
  EXPECT_FALSE(fs::exists(folder_.path() / "pulled"));
}

TEST_F(TransfersTest, DoesNotTouchAFolderWithOtherContent) {
  fs::create_directory(folder_.path() / "mine");
  std::ofstream(folder_.path() / "mine" / kManifest) << "mine";
  const auto version = Connect(*a_)->DownloadModelVersion("models/town/versions/1",
                                                          folder_.path() / "mine", nullptr);
  EXPECT_TRUE(absl::IsAlreadyExists(version.status())) << version.status();
  EXPECT_EQ(Bytes(folder_.path() / "mine" / kManifest), "mine");
}

TEST_F(TransfersTest, RefusesForeignFilesBeforeAnyByteIsSent) {
  const v1::UploadModelHeader good = HeaderOf(data("a") / "models" / "town" / "1");
  const auto expect = [&](const v1::UploadModelHeader& header, const std::string& field) {
    const grpc::Status status = Upload(header, {});
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << field;
    EXPECT_THAT(status.error_message(), HasSubstr(field));
  };
  for (const char* name : {"../model.json", "/etc/passwd", "", "made_by", kWeights}) {
    v1::UploadModelHeader header = good;
    header.mutable_files(0)->set_file(name);
    expect(header, std::string(name) == kWeights ? "header.files[1].file" : "header.files[0].file");
  }
  v1::UploadModelHeader header = good;
  for (int i = 0; i < 9; ++i) *header.add_files() = good.files(0);
  expect(header, "header.files");
  header = good;  // one of a pair
  *header.add_files() = good.files(0);
  header.mutable_files(2)->set_file("baselines.json");
  expect(header, "header.files");
  header = good;
  header.mutable_files()->RemoveLast();
  expect(header, "header.files");
  for (const int64_t size : {int64_t{-1}, int64_t{0}, int64_t{1} << 40}) {
    header = good;
    header.mutable_files(1)->set_size_bytes(size);
    expect(header, "header.files[1].size_bytes");
  }
  header = good;
  header.mutable_files(1)->set_sha256("../../" + std::string(58, 'a'));
  expect(header, "header.files[1].sha256");
  header = good;
  header.add_arrived_bytes(-1);
  header.add_arrived_bytes(0);
  expect(header, "header.arrived_bytes[0]");
  for (const char* parent : {"", "models/-", "models/../x", "models/town/versions/1"}) {
    header = good;
    header.set_parent(parent);
    expect(header, "header.parent");
  }
  EXPECT_THAT(Entries(), IsEmpty());
}

TEST_F(TransfersTest, AnIncompleteOrAlteredUploadCreatesNoVersion) {
  const fs::path source = data("a") / "models" / "town" / "1";
  const v1::UploadModelHeader header = HeaderOf(source);
  const std::string manifest = Bytes(source / kManifest);
  std::string weights = Bytes(source / kWeights);

  // Altered on its way.
  std::string altered = weights;
  altered[altered.size() / 2] = static_cast<char>(altered[altered.size() / 2] ^ 1);
  grpc::Status status = Upload(header, {manifest, altered});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DATA_LOSS) << status.error_message();
  EXPECT_EQ(Reason(status), "MODEL_INVALID");
  // The upload ends too early: the server keeps the bytes for the next upload and publishes
  // nothing.
  status = Upload(header, {manifest, weights.substr(0, 100)});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  // Longer than announced.
  status = Upload(header, {manifest, weights + "x"});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  EXPECT_THAT(Entries(), IsEmpty());
  // The files are complete and match their digests, but they are not a model: the weights are
  // another model's.
  const fs::path mixed = folder_.path() / "mixed";
  WriteModel(mixed, 2);
  fs::copy_file(source / kWeights, mixed / kWeights, fs::copy_options::overwrite_existing);
  status = Upload(HeaderOf(mixed), {Bytes(mixed / kManifest), weights});
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
  EXPECT_EQ(Reason(status), "MODEL_INVALID");
  EXPECT_THAT(status.error_message(), ::testing::Not(HasSubstr(folder_.path().string())));
  EXPECT_THAT(Entries(), IsEmpty());
  EXPECT_THAT(Versions(), IsEmpty());
}

TEST_F(TransfersTest, ADownloadSkipsTheBytesThatTheCallerHas) {
  grpc::ClientContext context;
  v1::DownloadModelVersionRequest request;
  request.set_name("models/town/versions/1");
  request.add_arrived_bytes(0);
  const auto stub = v1::ModelService::NewStub(a_->channel());
  v1::DownloadModelVersionResponse message;
  auto reader = stub->DownloadModelVersion(&context, request);
  EXPECT_FALSE(reader->Read(&message));
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);

  const fs::path source = data("a") / "models" / "town" / "1";
  request.add_arrived_bytes(5);
  grpc::ClientContext again;
  reader = stub->DownloadModelVersion(&again, request);
  ASSERT_TRUE(reader->Read(&message));
  EXPECT_EQ(message.header().model_version(), "models/town/versions/1");
  std::string bytes;
  while (reader->Read(&message)) bytes += message.chunk();
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(bytes, Bytes(source / kManifest) + Bytes(source / kWeights).substr(5));
}

}  // namespace
}  // namespace maneuver::integration::transfers_test
