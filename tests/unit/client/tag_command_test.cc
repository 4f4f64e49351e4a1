// maneuver tag with a model of the server, and tags show.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/cli/command.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/tag_service.grpc.pb.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::tag_command_test {
namespace {

using testing::ContainsRegex;
using testing::HasSubstr;
using testing::IsEmpty;

// Has no model. Where a test wants it, presses Ctrl-C once one is asked for, and never answers.
class Models final : public v1::ModelService::Service {
 public:
  std::string asked;  // the model of the last call
  bool interrupts = false;

 private:
  grpc::Status DownloadModelVersion(
      grpc::ServerContext* context, const v1::DownloadModelVersionRequest* request,
      grpc::ServerWriter<v1::DownloadModelVersionResponse>*) override {
    asked = request->name();
    if (!interrupts) return {grpc::StatusCode::NOT_FOUND, "there is no such model"};
    kill(getpid(), SIGINT);
    while (!context->IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return grpc::Status::CANCELLED;
  }
};

class Tags final : public v1::TagService::Service {
  grpc::Status GetTags(grpc::ServerContext*, const v1::GetTagsRequest* request,
                       v1::Tags* response) override {
    response->set_name(request->name());
    response->mutable_stride()->set_nanos(250'000'000);
    return grpc::Status::OK;
  }
};

class TagCommandTest : public testing::Test {
 protected:
  TagCommandTest() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&models_);
    builder.RegisterService(&tags_);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  ~TagCommandTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  Models models_;
  Tags tags_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

TEST_F(TagCommandTest, AFolderWithoutAModelDoesNotHideAModelOfTheServer) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "town");
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  const Result result =
      Maneuver({"--server", address_, "tag", "town", "--model", "town", "-o", "tags"});
  std::filesystem::current_path(before);
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(models_.asked, "models/town");
}

TEST_F(TagCommandTest, CtrlCDuringTheDownloadLeavesNothingOfTheModel) {
  const TemporaryFolder folder;
  const char* const set = std::getenv("TMPDIR");
  const std::string before = set == nullptr ? "" : set;
  setenv("TMPDIR", folder.path().c_str(), 1);
  std::signal(SIGINT, SIG_DFL);
  models_.interrupts = true;
  const Result result =
      Maneuver({"--server", address_, "tag", "town", "--model", "town/3", "-o", "/dev/null/tags"});
  if (set == nullptr) {
    unsetenv("TMPDIR");
  } else {
    setenv("TMPDIR", before.c_str(), 1);
  }
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("interrupted"));
  EXPECT_THAT(folder.Names(), IsEmpty());
}

TEST(TagCommandErrorsTest, AServerThatIsAwayIsNamedWithWhatToDo) {
  const Result result = Maneuver(
      {"--server", "127.0.0.1:1", "tag", "town", "--model", "town/3", "-o", "/dev/null/tags"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("no server answers at 127.0.0.1:1; start one"));
}

TEST(TagCommandErrorsTest, OptionsThatMakeNoSenseLeaveNoFolderBehind) {
  const TemporaryFolder folder;
  EXPECT_EXIT(
      {
        setenv("TMPDIR", folder.path().c_str(), 1);
        std::exit(Maneuver({"--tls-ca", "/nowhere.pem", "tag", "town", "--model", "town/3", "-o",
                            "/dev/null/tags"})
                      .status);
      },
      testing::ExitedWithCode(kUsage), "");
  EXPECT_THAT(folder.Names(), IsEmpty());
}

TEST_F(TagCommandTest, ShowsTheStrideAsItWasSet) {
  const Result result = Maneuver({"--server", address_, "tags", "show", "june"});
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(result.out, ContainsRegex("stride +0\\.25 s\n"));
}

}  // namespace
}  // namespace maneuver::cli::tag_command_test
