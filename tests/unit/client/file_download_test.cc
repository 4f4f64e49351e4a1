#include "client/file_download.h"

#include <gtest/gtest.h>

#include <string>

#include "client/file_digest.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::client::file_download_test {
namespace {

TEST(FileDownloadTest, CountsWhatArrivesAfterACleanStartAsProgress) {
  const TemporaryFolder folder;
  const std::string content = "0123456789";
  DownloadHeader header;
  header.resource = "models/m/versions/1";
  v1::ModelFile* file = header.files.Add();
  file->set_file("model.json");
  file->set_size_bytes(static_cast<int64_t>(content.size()));
  file->set_sha256(Sha256Of(content));
  // The first call sends altered bytes. The second starts clean, and breaks after four bytes.
  int calls = 0;
  const ReadDownload read = [&](grpc::ClientContext&, const std::string&, const ArrivedBytes&,
                                const TakeDownload& take) -> grpc::Status {
    ++calls;
    if (!take.header(header)) return grpc::Status::CANCELLED;
    take.chunk(calls == 1 ? "9876543210" : calls == 2 ? "0123" : "456789");
    return calls == 2 ? grpc::Status(grpc::StatusCode::UNAVAILABLE, "broken") : grpc::Status::OK;
  };
  int waits = 0;
  ClientOptions options;
  options.retry.initial_backoff = absl::Milliseconds(1);
  options.on_retry = [&](const absl::Status&, absl::Duration) { ++waits; };
  const DownloadTarget target = {
      .name = "models/m", .folder = (folder / "m").string(), .noun = "a model", .most_files = 16};
  UploadProgress last;
  const auto downloaded = DownloadFiles(
      options, target, read, [](grpc::ClientContext&) {},
      [&](const UploadProgress& now) { last = now; }, {});
  ASSERT_TRUE(downloaded.ok()) << downloaded.status();
  EXPECT_EQ(*downloaded, "models/m/versions/1");
  EXPECT_EQ(calls, 3);
  EXPECT_EQ(waits, 0);  // bytes arrived before the stream broke
  EXPECT_EQ(last.there, 10);
  EXPECT_EQ(last.total, 10);
}

}  // namespace
}  // namespace maneuver::client::file_download_test
