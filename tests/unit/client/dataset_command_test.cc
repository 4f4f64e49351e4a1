// maneuver dataset show and annotate, of folders, and list.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/command.h"
#include "client/cli/dataset_show.h"
#include "client/cli/maneuver.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "model/data/dataset_folder.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::dataset_command_test {
namespace {

using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

class DatasetCommandTest : public testing::Test {
 protected:
  DatasetCommandTest() {
    auto writer = data::DatasetWriter::Create(town(), "a test");
    for (int i = 0; i < 3; ++i) {
      EXPECT_TRUE((*writer)->Add(data::SmallRecording(absl::StrCat("r", i))).ok());
    }
    EXPECT_TRUE((*writer)->Commit().ok());
  }

  std::string town() const { return (folder_ / "town").string(); }

  int Maneuver(const std::vector<std::string>& arguments) {
    std::istringstream in;
    out_.str("");
    err_.str("");
    Environment environment(in, out_, err_);
    return RunManeuver(arguments, environment);
  }

  std::string WriteLabels(const std::string& lines) const {
    const std::string file = (folder_ / "labels.csv").string();
    std::ofstream(file) << "recording,target,time,action\n" << lines;
    return file;
  }

  const TemporaryFolder folder_;
  std::ostringstream out_;
  std::ostringstream err_;
};

// Has one dataset, and one more that cannot be read.
class Datasets final : public v1::DatasetService::Service {
  grpc::Status ListDatasets(grpc::ServerContext*, const v1::ListDatasetsRequest*,
                            v1::ListDatasetsResponse* response) override {
    response->add_datasets()->set_name("datasets/broken");
    v1::Dataset* const sound = response->add_datasets();
    sound->set_name("datasets/town");
    sound->set_format_version(1);
    sound->set_recordings(3);
    sound->set_origin("a test");
    return grpc::Status::OK;
  }
};

TEST_F(DatasetCommandTest, MarksADatasetThatCannotBeRead) {
  Datasets datasets;
  int port = 0;
  const auto server = grpc::ServerBuilder()
                          .AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port)
                          .RegisterService(&datasets)
                          .BuildAndStart();
  EXPECT_EQ(Maneuver({"--server", absl::StrCat("127.0.0.1:", port), "dataset", "list"}), kOk);
  EXPECT_THAT(out_.str(), AllOf(ContainsRegex("broken +- +- +- +- +unreadable"),
                                ContainsRegex("town +3 .*a test")));
  EXPECT_EQ(err_.str(), "datasets/broken cannot be read; maneuver dataset show broken says why\n");
  server->Shutdown(std::chrono::system_clock::now());
}

TEST_F(DatasetCommandTest, ShowsAFolderLikeADatasetOfTheServer) {
  EXPECT_EQ(Maneuver({"dataset", "show", town(), "--set", "examples.stride=1s"}), kOk)
      << err_.str();
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("a test"), ContainsRegex("recordings +3\n"),
                                HasSubstr("one each 1 s"), HasSubstr("3 of 3 recordings"),
                                ContainsRegex("VEHICLE +3\n")));
  const std::string picture = (folder_ / "town.png").string();
  EXPECT_EQ(Maneuver({"--output", "json", "dataset", "show", town(), "--plot", picture}), kOk);
  EXPECT_THAT(out_.str(), HasSubstr("\"agentsByType\""));
  EXPECT_GT(std::filesystem::file_size(picture), 10'000u);
}

TEST_F(DatasetCommandTest, ADatasetOfTheServerPrecedesAFolderOfThatName) {
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::create_directory(folder_ / "datasets");
  std::filesystem::copy(town(), folder_ / "datasets/town",
                        std::filesystem::copy_options::recursive);
  std::filesystem::current_path(folder_ / ".");
  // Nobody listens there: what succeeds has read the folder.
  const std::vector<std::string> nobody = {"--server", "127.0.0.1:1"};
  const auto ask = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), nobody.begin(), nobody.end());
    return Maneuver(arguments);
  };
  EXPECT_EQ(ask({"dataset", "show", "town"}), kFailed);
  EXPECT_THAT(err_.str(), HasSubstr("maneuver dataset show ./town"));
  EXPECT_EQ(ask({"scenario", "list", "datasets/town"}), kFailed);
  EXPECT_EQ(ask({"dataset", "show", "./town"}), kOk);
  EXPECT_EQ(ask({"scenario", "list", "./datasets/town"}), kOk);
  std::filesystem::current_path(before);
}

TEST_F(DatasetCommandTest, RefusesInvalidExampleSettings) {
  EXPECT_EQ(Maneuver({"dataset", "show", town(), "--set", "examples.strid=1s"}), kUsage);
  EXPECT_NE(Maneuver({"dataset", "show", town(), "--set", "examples.stride=-1s"}), kOk);
}

TEST_F(DatasetCommandTest, LabellingCreatesANewFolder) {
  const std::string labels = WriteLabels("r1,1,2.0,turn_left\nr2,1,2.0,stop\nr0,1,1.0,stop\n");
  const std::string output = (folder_ / "labelled").string();
  ASSERT_EQ(Maneuver({"dataset", "annotate", town(), labels, output}), kOk) << err_.str();
  EXPECT_THAT(out_.str(), AllOf(ContainsRegex("stop +2\n"), ContainsRegex("turn_left +1\n")));
  EXPECT_TRUE(data::VerifyDatasetFolder(output).ok());
  ASSERT_EQ(Maneuver({"dataset", "show", output}), kOk);
  EXPECT_THAT(out_.str(), ContainsRegex("turn_left +1\n"));
}

TEST_F(DatasetCommandTest, ListsUnusableLabelsByLineAndWritesNothing) {
  const std::string labels = WriteLabels("r1,1,2.0,turn_left\nr9,1,2.0,stop\nr0,1,1.0,stopp\n");
  const std::string output = (folder_ / "labelled").string();
  EXPECT_EQ(Maneuver({"dataset", "annotate", town(), labels, output, "--action", "turn_left",
                      "--action", "stop"}),
            kUsage);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("labels.csv:3: the dataset has no recording 'r9'"),
                                HasSubstr("labels.csv:4: action 'stopp'"),
                                Not(HasSubstr("labels.csv:2")), HasSubstr("2 of the lines")));
  EXPECT_FALSE(std::filesystem::exists(output));
}

TEST_F(DatasetCommandTest, AFolderThatCannotBeLookedAtIsNoReasonToAbort) {
  EXPECT_EQ(Maneuver({"scenario", "list", std::string(300, 'a')}), kFailed);
  EXPECT_THAT(err_.str(), HasSubstr("name too long"));
}

TEST_F(DatasetCommandTest, SaysThatASourceDoesNotExist) {
  EXPECT_EQ(Maneuver({"scenario", "list", town() + "-none"}), kFailed);
  EXPECT_EQ(err_.str(), "maneuver: " + town() + "-none does not exist\n");
  EXPECT_EQ(Maneuver({"scenario", "list", "nowhere"}), kFailed);
  EXPECT_EQ(err_.str(),
            "maneuver: nowhere does not exist; for a dataset on the server use datasets/nowhere\n");
  EXPECT_EQ(Maneuver({"scenario", "list", "/"}), kFailed);
  EXPECT_EQ(err_.str(), "maneuver: / is not a dataset folder\n");
}

TEST_F(DatasetCommandTest, IndexesAFolderAndNamesADamagedIndex) {
  ASSERT_EQ(Maneuver({"dataset", "index", town()}), kOk) << err_.str();
  EXPECT_THAT(out_.str(), HasSubstr("3 recordings indexed"));
  EXPECT_EQ(err_.str(), "");
  std::ofstream(town() + "/.scenarios-00000.tfrecord.index") << "damage";
  ASSERT_EQ(Maneuver({"dataset", "index", town()}), kOk);
  EXPECT_THAT(err_.str(), HasSubstr("index .scenarios-00000.tfrecord.index is damaged"));
  ASSERT_EQ(Maneuver({"dataset", "index", town()}), kOk);
  EXPECT_EQ(err_.str(), "");
  EXPECT_EQ(Maneuver({"dataset", "index", town() + "-none"}), kFailed);
}

TEST_F(DatasetCommandTest, WithJsonOutputAnIndexIsReportedAsJson) {
  ASSERT_EQ(Maneuver({"--output", "json", "dataset", "index", town()}), kOk) << err_.str();
  const auto indexed = nlohmann::json::parse(out_.str(), nullptr, /*allow_exceptions=*/false);
  ASSERT_FALSE(indexed.is_discarded()) << out_.str();
  EXPECT_EQ(indexed["folder"], town());
  EXPECT_EQ(indexed["recordings"], 3);
}

TEST(DescriptionTextTest, BarsAreProportionalToTheirShares) {
  v1::DatasetSummary summary;
  for (const double edge : {0.0, 1.0, 2.5, 40.0}) summary.mutable_speeds()->add_edges(edge);
  for (const int64_t count : {1000, 500, 0}) summary.mutable_speeds()->add_counts(count);
  const std::string text = DescriptionText(summary, /*color=*/false);
  EXPECT_THAT(text, HasSubstr("0 to 1 m/s       1 000  66.7 %  " + std::string(40, '#') + "\n"));
  EXPECT_THAT(text, HasSubstr("1 to 2.5 m/s       500  33.3 %  " + std::string(20, '#') + "\n"));
  EXPECT_THAT(text, HasSubstr("over 2.5 m/s         0   0.0 %\n"));
}

TEST(DescriptionTextTest, LeavesOutAHistogramThatLacksEdges) {
  v1::DatasetSummary summary;
  for (v1::Histogram* histogram : {summary.mutable_speeds(), summary.mutable_turns()}) {
    histogram->add_edges(0.0);
    for (const int64_t count : {1000, 500}) histogram->add_counts(count);
  }
  const std::string text = DescriptionText(summary, /*color=*/false);
  EXPECT_THAT(text, AllOf(Not(HasSubstr("SPEED")), Not(HasSubstr("TURN"))));
}

}  // namespace
}  // namespace maneuver::cli::dataset_command_test
