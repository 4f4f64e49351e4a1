// What the command says when something goes wrong, here or at the server.

#include <gmock/gmock.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <ext/stdio_sync_filebuf.h>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/command.h"
#include "client/cli/json_files.h"
#include "client/cli/maneuver.h"
#include "client/cli/settings_argument.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "maneuver/v1/status.pb.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/data/dataset_folder.h"
#include "tests/integration/test_certificates.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/client/test_server.h"
#include "tests/unit/model/data/recordings_for_tests.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::command_errors_test {
namespace {

using maneuver::integration::TestAuthority;
using maneuver::integration::TestCertificate;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// Port 1 of this machine: nobody listens.
constexpr char kNobody[] = "127.0.0.1:1";
constexpr char kScene[] = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";

void WriteText(const std::string& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}

class LocalErrorsTest : public ::testing::Test {
 protected:
  LocalErrorsTest() {
    auto writer = data::DatasetWriter::Create(town_, "a test");
    EXPECT_TRUE((*writer)->Add(data::SmallRecording("r0")).ok());
    EXPECT_TRUE((*writer)->Commit().ok());
  }

  const TemporaryFolder folder_;
  const std::string town_ = folder_ / "town";
  const std::string nowhere_ = folder_ / "none/x.png";
};

TEST_F(LocalErrorsTest, NamesAFileThatCannotBeWrittenAndNotTheServer) {
  v1::TrainingSettings settings;
  const v1::ModelSpec spec = artifact::ResolveTrainingSettings(settings).model();
  const std::string model = folder_ / "model";
  ASSERT_TRUE(artifact::WriteModelFolder(model, inference::RandomModel(spec, 1)).ok());
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"scenario", "extract", town_, "r0", "--time", "2", "--target", "1", "-o", nowhere_},
           {"dataset", "show", town_, "--plot", nowhere_},
           {"model", "export", model, "--onnx", nowhere_}}) {
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kFailed);
    EXPECT_EQ(result.err, "maneuver: cannot write " + nowhere_ + ": No such file or directory\n");
  }
  const absl::Status full = WriteFile("/dev/full", "something");
  EXPECT_EQ(full.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(full.message(), "cannot write /dev/full: No space left on device");
}

TEST_F(LocalErrorsTest, FailsIfAnAnswerCannotBeWritten) {
  std::istringstream in;
  std::ofstream out("/dev/full");
  std::ostringstream err;
  Environment environment(in, out, err);
  EXPECT_EQ(RunManeuver({"scenario", "list", town_}, environment), kFailed);
  EXPECT_EQ(err.str(), "maneuver: cannot write to standard output: No space left on device\n");
}

TEST_F(LocalErrorsTest, WithJsonOutputThatAnAnswerCannotBeWrittenIsJson) {
  std::istringstream in;
  std::ofstream out("/dev/full");
  std::ostringstream err;
  Environment environment(in, out, err);
  EXPECT_EQ(RunManeuver({"--output", "json", "scenario", "list", town_}, environment), kFailed);
  EXPECT_EQ(err.str(),
            "{\"error\":{\"code\":\"FAILED_PRECONDITION\",\"message\":\"cannot write to standard "
            "output: No space left on device\"}}\n");
}

// Returns what Flush says after an answer that is longer than any buffer was written to the file as
// std::cout writes. Closes the file.
std::string SaidAfterALongAnswer(std::FILE* file) {
  __gnu_cxx::stdio_sync_filebuf<char> buffer(file);
  std::ostream out(&buffer);
  std::istringstream in;
  std::ostringstream err;
  Environment environment(in, out, err);
  out << std::string(1'000'000, 'x');
  const bool is_written = environment.Flush();
  EXPECT_EQ(is_written, err.str().empty());
  std::fclose(file);
  return err.str();
}

TEST(FlushTest, SaysWhyALongAnswerCannotBeWritten) {
  EXPECT_EQ(SaidAfterALongAnswer(std::fopen("/dev/full", "w")),
            "maneuver: cannot write to standard output: No space left on device\n");
}

TEST(FlushTest, TakesAPipeThatItsReaderHasClosedForNoFailure) {
  std::signal(SIGPIPE, SIG_IGN);
  std::array<int, 2> ends;
  ASSERT_EQ(pipe(ends.data()), 0);
  close(ends[0]);
  EXPECT_EQ(SaidAfterALongAnswer(fdopen(ends[1], "w")), "");
}

TEST_F(LocalErrorsTest, NamesTheWholePathOfAFolderThatCannotBeCreated) {
  EXPECT_THAT(Maneuver({"synthesize", nowhere_, "--recordings", "1"}).err,
              HasSubstr(nowhere_ + ": cannot create"));
  const std::string xml = folder_ / "a.xml";
  WriteText(xml, "<?xml version=\"1.0\"?>\n<commonRoad/>\n");
  EXPECT_THAT(Maneuver({"import", "waymo", nowhere_, xml}).err, HasSubstr(nowhere_ + ": cannot"));
}

TEST_F(LocalErrorsTest, RecognisesXmlInsteadOfReportingADamagedRecord) {
  const std::string xml = folder_ / "a.xml";
  WriteText(xml, "<?xml version=\"1.0\"?>\n<commonRoad/>\n");
  const Result result = Maneuver({"import", "waymo", folder_ / "out", xml});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, AllOf(HasSubstr(xml + " is XML, not a file of TFRecords"),
                                HasSubstr("maneuver import commonroad"), Not(HasSubstr("CRC"))));
}

TEST_F(LocalErrorsTest, ChecksTheFigureFolderBeforeAskingTheServer) {
  WriteText(folder_ / "file", "");
  const std::string figures = folder_ / "file/figures";
  const Result result = Maneuver(
      {"--server", kNobody, "evaluate", "town", "--dataset", "town", "--figures", figures});
  EXPECT_EQ(result.status, kUsage);
  EXPECT_THAT(result.err, HasSubstr("cannot write into the folder " + figures));
}

TEST(CommandErrorsTest, InputWithoutEndIsRefused) {
  const Result scenes = Maneuver({"--server", kNobody, "predict", "/dev/zero"});
  EXPECT_EQ(scenes.status, kUsage);
  EXPECT_THAT(scenes.err, HasSubstr("/dev/zero has more than 1 GiB"));
}

TEST(CommandErrorsTest, AnErrorWhileReadingIsNotAnEmptyFile) {
  // Memory that is not there cannot be read.
  EXPECT_THAT(Maneuver({"--server", kNobody, "predict", "/proc/self/mem"}).err,
              HasSubstr("cannot read /proc/self/mem: Input/output error"));
}

TEST(CommandErrorsTest, AnErrorOfStandardInputIsNotItsEnd) {
  // A folder can be opened, but not read.
  ASSERT_NE(std::freopen("/", "r", stdin), nullptr);
  std::ostringstream out;
  std::ostringstream err;
  Environment environment(std::cin, out, err);
  RunManeuver({"--server", kNobody, "predict", "-"}, environment);
  EXPECT_THAT(err.str(), HasSubstr("cannot read standard input: Is a directory"));
  ASSERT_NE(std::freopen("/dev/null", "r", stdin), nullptr);
  std::cin.clear();
}

TEST(CommandErrorsTest, TheMarkThatSomeEditorsBeginAFileWithIsSkipped) {
  client::TestServer server;
  EXPECT_THAT(
      Maneuver({"--server", server.address(), "predict", "-"}, absl::StrCat("\xef\xbb\xbf", kScene))
          .err,
      Not(HasSubstr("proto3 JSON")));
}

TEST(CommandErrorsTest, RefusesAPictureThatIsNotPng) {
  const Result result = Maneuver({"predict", "-", "--plot", "out/x.jpg"}, kScene);
  EXPECT_EQ(result.status, kUsage);
  EXPECT_THAT(result.err, HasSubstr("out/x.jpg is not the name of a PNG file; name it such as "
                                    "out/x.png"));
}

TEST(CommandErrorsTest, RefusesWhatIsNotANumber) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--timeout", "nan", "health"},
           {"load", "scene.json", "--rate", "nan"},
           {"load", "scene.json", "--duration", "-NaN"},
           {"synthesize", "/dev/null/town", "--duration", "nan(7)"}}) {
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kUsage) << arguments[0];
    EXPECT_THAT(result.err, HasSubstr("is not a number")) << arguments[0];
  }
}

TEST(CommandErrorsTest, RefusesRecordingsOfMoreStatesThanAnAgentMayHave) {
  const Result refused = Maneuver({"synthesize", "/dev/null/town", "--duration", "200"});
  EXPECT_EQ(refused.status, kUsage);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("--duration"), HasSubstr("199.9")));
  EXPECT_EQ(Maneuver({"synthesize", "/dev/null/town", "--duration", "199.9"}).status, kFailed);
}

TEST(CommandErrorsTest, RefusesIntegersBeyondTheLargest) {
  for (const std::string seed :
       {"9223372036854775808", "18446744073709551616", "-99999999999999999999",
        "+18446744073709551616", "0x8000000000000000"}) {
    const Result result = Maneuver({"synthesize", "/dev/null/town", "--seed", seed});
    EXPECT_EQ(result.status, kUsage) << seed;
    EXPECT_THAT(result.err, HasSubstr(seed)) << seed;
  }
}

TEST(CommandErrorsTest, RefusesAZeroThatMeansThePresetsValue) {
  for (const std::vector<std::string>& zero : std::vector<std::vector<std::string>>{
           {"--epochs", "0"},
           {"--set", "optimization.joint_epochs=0"},
           {"--set", "optimization.jointEpochs=0", "--preset", "paper"}}) {
    std::vector<std::string> arguments = {"--server", kNobody,     "train",
                                          "town",     "--dataset", "town"};
    arguments.insert(arguments.end(), zero.begin(), zero.end());
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kUsage) << zero[1];
    EXPECT_THAT(result.err, HasSubstr("cannot be 0: that value means the preset's own, "));
  }
  EXPECT_EQ(Maneuver({"--server", kNobody, "cross-validate", "town", "--set",
                      "optimization.joint_epochs=0"})
                .status,
            kUsage);
}

// A message keeps no zeros: they are looked for in the text.
TEST(CommandErrorsTest, AZeroInASettingsFileIsRefusedLikeOneOfAnOption) {
  const TemporaryFolder folder;
  for (const char* settings : {R"({"optimization": {"joint_epochs": 0}})",
                               "\xef\xbb\xbf"
                               R"({"optimization": {"joint_epochs": 0}})",
                               R"({"optimization": {"jointEpochs": 0, "batchSize": 32}})",
                               R"({"seed": "7", "optimization": {"joint_epochs": 0.0}})"}) {
    WriteText(folder / "settings.json", settings);
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"train", "town", "--dataset", "town"}, {"cross-validate", "town"}}) {
      std::vector<std::string> arguments = {"--server", kNobody};
      arguments.insert(arguments.end(), command.begin(), command.end());
      arguments.insert(arguments.end(), {"--settings", folder / "settings.json"});
      const Result result = Maneuver(arguments);
      EXPECT_EQ(result.status, kUsage) << settings;
      EXPECT_THAT(result.err, HasSubstr("cannot be 0: that value means the preset's own, "));
    }
  }
}

TEST(CommandErrorsTest, WarningsOfAnAnswerArePrintedBesideIt) {
  client::TestServer server;
  bool strict = false;
  server.on_predict = [&](auto*, const v1::PredictRequest& request, v1::PredictResponse* response) {
    strict = request.strict();
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->set_scenario_id("scene\x1b");
    prediction->add_targets()->set_target_id(7);
    v1::SceneWarning* warning = prediction->add_warnings();
    warning->set_field("scenarios[0].agents[0].states[0].heading");
    warning->set_description("agent 7 has a heading of 180 rad");
    return grpc::Status::OK;
  };
  std::vector<std::string> arguments = {"--server", server.address(), "predict", "-"};
  Result result = Maneuver(arguments, kScene);
  EXPECT_EQ(result.status, kOk);
  EXPECT_THAT(result.err, HasSubstr("maneuver: warning: scene"));
  EXPECT_THAT(result.err, HasSubstr(": scenarios[0].agents[0].states[0].heading: agent 7 has a "
                                    "heading of 180 rad\n"));
  EXPECT_THAT(result.err, Not(HasSubstr("\x1b")));
  EXPECT_THAT(result.out, Not(HasSubstr("warning")));
  EXPECT_FALSE(strict);
  arguments.emplace_back("--strict");
  EXPECT_EQ(Maneuver(arguments, kScene).status, kOk);
  EXPECT_TRUE(strict);
  arguments.insert(arguments.end(), {"--output", "json"});
  EXPECT_THAT(Maneuver(arguments, kScene).out, HasSubstr("\"warnings\""));
  EXPECT_EQ(Maneuver({"classify", "--strict", "/nowhere"}, kScene).status, kUsage);
}

TEST(CommandErrorsTest, SettingsOfExamplesHaveOneNameInAllCommands) {
  const TemporaryFolder folder;
  for (const char* setting : {"examples.stride=soon", "stride=soon"}) {
    for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
             {"evaluate", "town", "--dataset", "town"}, {"dataset", "show", "town"}}) {
      std::vector<std::string> arguments = {"--server", kNobody};
      arguments.insert(arguments.end(), command.begin(), command.end());
      arguments.insert(arguments.end(), {"--set", setting});
      const Result result = Maneuver(arguments);
      EXPECT_EQ(result.status, kUsage) << setting;
      EXPECT_THAT(result.err, HasSubstr("soon")) << "the field is known, its value is wrong";
    }
  }
}

TEST(CommandErrorsTest, AcceptsAZeroThatTheServerCanTellFromUnset) {
  client::TestServer server;
  v1::OptimizationSettings heard;
  server.on_train = [&](const v1::TrainRequest& request, v1::Job*) {
    heard = request.settings().optimization();
    return grpc::Status::OK;
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "train", "town", "--dataset", "town",
                      "--mixture-epochs", "0", "--epochs", "3", "--detach"})
                .status,
            kOk);
  EXPECT_TRUE(heard.has_mixture_epochs());
  EXPECT_EQ(heard.mixture_epochs(), 0);
  EXPECT_EQ(heard.joint_epochs(), 3);
}

TEST(CommandErrorsTest, OutcomesAreNotReportedWithInvalidExampleSettings) {
  const Result result = Maneuver({"--server", kNobody, "outcomes", "report", "yesterday", "--model",
                                  "town", "--set", "stride=-1s"});
  EXPECT_EQ(result.status, kUsage);
  EXPECT_THAT(result.err, HasSubstr("stride"));
}

TEST(CommandErrorsTest, AJobThatIsNotThereDoesNotContinue) {
  client::TestServer server;
  server.on_watch = [](const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::NOT_FOUND, "no such job");
  };
  const Result result = Maneuver({"--server", server.address(), "job", "watch", "typo"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("no such job"));
  EXPECT_THAT(result.err, Not(HasSubstr("continues")));
}

TEST(CommandErrorsTest, ATargetWithoutALikelyActionKeepsItsName) {
  client::TestServer server;
  server.on_predict = [](auto*, const v1::PredictRequest&, v1::PredictResponse* response) {
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->set_scenario_id("a");
    for (const double largest : {0.6, 0.4}) {
      v1::TargetPrediction* target = prediction->add_targets();
      target->set_target_id(largest == 0.6 ? 17 : 18);
      target->add_probabilities(largest);
      for (int i = 0; i < 3; ++i) target->add_probabilities((1.0 - largest) / 3.0);
    }
    return grpc::Status::OK;
  };
  const Result result =
      Maneuver({"--server", server.address(), "predict", "-", "--at-least", "0.5"}, kScene);
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(result.out, HasSubstr("17"));
  EXPECT_THAT(result.out, HasSubstr("18"));
}

TEST(CommandErrorsTest, AJobThatRanForTooLongDoesNotBlameTheServer) {
  client::TestServer server;
  server.on_watch = [](const auto&, auto* writer) {
    v1::WatchJobResponse event;
    event.mutable_job()->set_name("jobs/3f2a");
    event.mutable_job()->set_state(v1::JOB_STATE_FAILED);
    event.mutable_job()->mutable_error()->set_code(4);  // DEADLINE_EXCEEDED
    event.mutable_job()->mutable_error()->set_message("the job ran for 60 s");
    writer->Write(event);
    return grpc::Status::OK;
  };
  const Result result = Maneuver({"--server", server.address(), "job", "watch", "3f2a"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_EQ(result.err, "maneuver: jobs/3f2a failed: the job ran for 60 s\n");
}

TEST(CommandErrorsTest, AMissedDeadlineNamesTheOptionThatSetIt) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::DEADLINE_EXCEEDED, "too late");
  };
  std::vector<std::string> arguments = {"--server", server.address(), "predict", "-"};
  EXPECT_THAT(Maneuver(arguments, kScene).err, HasSubstr("allow more with --timeout SECONDS"));
  arguments.insert(arguments.end(), {"--deadline", "5000"});
  EXPECT_THAT(Maneuver(arguments, kScene).err,
              HasSubstr("allow more with --deadline MILLISECONDS"));
}

TEST(CommandErrorsTest, ServerMessagesNameCommandsInsteadOfMethods) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::NOT_FOUND,
                        "there is no models/town; ListModelVersions names those that exist");
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: there is no models/town; maneuver model list shows those that exist\n");
  server.on_predict = [](auto*, const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION,
                        "town/1 has no action named \"fly\"; see its actions with GetActionSet");
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: town/1 has no action named \"fly\"; maneuver model actions shows those that "
            "it has\n");
  server.on_predict = [](auto*, const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION,
                        "it has an alias; point each alias to another version with SetModelAlias, "
                        "or remove it with DeleteModelAlias");
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: it has an alias; point each alias to another version with maneuver model "
            "promote, or remove it with maneuver model unalias\n");
}

TEST(CommandErrorsTest, SaysWhatIsWrongWithASceneWrittenByHand) {
  const auto error = [](const std::string& scene) {
    return Maneuver({"--server", kNobody, "predict", "-"}, scene).err;
  };
  EXPECT_THAT(error(R"({"agents": [{"type": "car"}]})"),
              AllOf(HasSubstr("invalid value \"car\""),
                    HasSubstr("; the values are AGENT_TYPE_VEHICLE, AGENT_TYPE_PEDESTRIAN")));
  EXPECT_EQ(error("[]"),
            "maneuver: standard input is not a Scenario in proto3 JSON: Root element must be a "
            "message.\n");
  const TemporaryFolder folder;
  EXPECT_EQ(Maneuver({"--server", kNobody, "predict", folder.path().string()}).err,
            "maneuver: cannot read " + folder.path().string() + ": it is a folder\n");
}

grpc::Status ErrorWith(grpc::StatusCode code, const std::string& message,
                       const v1::ErrorInfo& info) {
  v1::Status status;
  google::protobuf::Any& detail = *status.add_details();
  detail.set_type_url("type.googleapis.com/google.rpc.ErrorInfo");
  detail.set_value(info.SerializeAsString());
  return {code, message, status.SerializeAsString()};
}

TEST(CommandErrorsTest, ADeadlineThatTheServerSetsIsNotTheCallers) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) {
    v1::ErrorInfo info;
    info.set_reason("REQUEST_TOO_SLOW");
    return ErrorWith(grpc::StatusCode::DEADLINE_EXCEEDED, "the request took more than 300 s", info);
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: the request took more than 300 s\n");
}

TEST(CommandErrorsTest, AnErrorOfThisMachineSaysNothingOfTheServer) {
  std::istringstream in;
  std::ostringstream out;
  std::ostringstream err;
  Environment environment(in, out, err);
  EXPECT_EQ(environment.Fail(absl::UnavailableError("Stale file handle")), kFailed);
  EXPECT_EQ(environment.FailCall(absl::UnavailableError("Connection refused")), kFailed);
  EXPECT_THAT(err.str(), AllOf(HasSubstr("maneuver: Stale file handle\n"),
                               HasSubstr("maneuver: no server answers at 127.0.0.1:8470")));
}

TEST(CommandErrorsTest, NamesEveryActionThatIsGone) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) {
    v1::ErrorInfo gone;
    gone.set_reason("ACTION_NAME_GONE");
    (*gone.mutable_metadata())["action_name_0"] = "fly";
    (*gone.mutable_metadata())["action_name_1"] = "sink";
    return ErrorWith(grpc::StatusCode::FAILED_PRECONDITION,
                     "required_action_names: town/1 has no action named \"fly\" (and 1 more)",
                     gone);
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: --require-name: town/1 has no action named \"fly\" (and 1 more)\n"
            "  nor \"sink\"\n");
}

TEST(CommandErrorsTest, ARefusedSceneHasNoTableAndNeedsNoName) {
  client::TestServer server;
  server.on_predict = [](auto*, const auto&, v1::PredictResponse* response) {
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->mutable_error()->set_code(static_cast<int>(absl::StatusCode::kInvalidArgument));
    prediction->mutable_error()->set_message("scenarios[0].agents[0].length: is 0 m");
    return grpc::Status::OK;
  };
  const Result result = Maneuver({"--server", server.address(), "predict", "-"}, kScene);
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.out, IsEmpty());
  EXPECT_EQ(result.err, "maneuver: scenarios[0].agents[0].length: is 0 m\n");

  server.on_classify = [](const auto&, v1::ClassifyTrajectoriesResponse* response) {
    v1::TargetClassification& target = *response->add_classifications()->add_targets();
    target.mutable_error()->set_code(static_cast<int>(absl::StatusCode::kFailedPrecondition));
    target.mutable_error()->set_message("scenarios[0].agents[0].states: too few");
    return grpc::Status::OK;
  };
  const Result classified = Maneuver({"--server", server.address(), "classify", "-"}, kScene);
  EXPECT_EQ(classified.status, kFailed);
  EXPECT_THAT(classified.out, IsEmpty());
}

TEST(CommandErrorsTest, SuggestsTheNearestCommandForAnUnknownOne) {
  const Result trian = Maneuver({"trian", "town", "--dataset", "town"});
  EXPECT_EQ(trian.status, kUsage);
  EXPECT_EQ(trian.err,
            "maneuver has no command trian; did you mean train?\nTry: maneuver --help\n");
  EXPECT_EQ(Maneuver({"model", "lits"}).err,
            "maneuver model has no command lits; did you mean list?\nTry: maneuver model --help\n");
  EXPECT_EQ(Maneuver({"fly"}).err, "maneuver has no command fly\nTry: maneuver --help\n");
}

TEST(CommandErrorsTest, NamesAnUnknownOptionAlsoIfAnotherIsMissing) {
  EXPECT_EQ(Maneuver({"train", "town", "--dataste", "town"}).err,
            "maneuver train has no option --dataste; did you mean --dataset?\n"
            "Try: maneuver train --help\n");
  EXPECT_EQ(Maneuver({"model", "list", "--sever=x"}).err,
            "maneuver model list has no option --sever; did you mean --server?\n"
            "Try: maneuver model list --help\n");
}

TEST(CommandErrorsTest, NamesTheProgramThatHasAnUnknownCommand) {
  const Result token = Maneuver({"token", "create", "--name", "planner"});
  EXPECT_EQ(token.status, kUsage);
  EXPECT_EQ(token.err,
            "maneuver has no command token; maneuverd has: maneuverd token --help\n"
            "Try: maneuver --help\n");
  EXPECT_THAT(Maneuver({"prune", "town-3"}).err, HasSubstr("maneuver-trainer prune --help"));
  // Another group's command of that name does not exist anywhere.
  EXPECT_THAT(Maneuver({"model", "token"}).err, Not(HasSubstr("maneuverd")));
}

TEST(CommandErrorsTest, HelpIsAlsoACommand) {
  const Result whole = Maneuver({"help"});
  EXPECT_EQ(whole.status, kOk);
  EXPECT_EQ(whole.out, Maneuver({"--help"}).out);
  const Result one = Maneuver({"help", "model", "list"});
  EXPECT_EQ(one.status, kOk);
  EXPECT_EQ(one.out, Maneuver({"model", "list", "--help"}).out);
}

TEST(CommandErrorsTest, HelpNamesTheUnknownCommand) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"help", "model", "lits"}, {"model", "lits", "--help"}}) {
    const Result unknown = Maneuver(arguments);
    EXPECT_EQ(unknown.status, kUsage);
    EXPECT_THAT(unknown.out, IsEmpty());
    EXPECT_EQ(
        unknown.err,
        "maneuver model has no command lits; did you mean list?\nTry: maneuver model --help\n");
  }
}

// {"error": {...}} of one line.
google::protobuf::Struct ErrorOf(const std::string& line) {
  google::protobuf::Struct parsed;
  EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(line, &parsed).ok()) << line;
  EXPECT_EQ(line.find('\n'), line.size() - 1) << line;
  return parsed.fields().at("error").struct_value();
}

TEST(CommandErrorsTest, WithJsonOutputErrorsAreJson) {
  const Result failed = Maneuver({"--output", "json", "--server", kNobody, "health"});
  EXPECT_EQ(failed.status, kFailed);
  google::protobuf::Struct error = ErrorOf(failed.err);
  EXPECT_EQ(error.fields().at("code").string_value(), "UNAVAILABLE");
  EXPECT_THAT(error.fields().at("message").string_value(), HasSubstr("no server answers"));

  const Result misspelt = Maneuver({"trian", "--output=json"});
  EXPECT_EQ(misspelt.status, kUsage);
  error = ErrorOf(misspelt.err);
  EXPECT_EQ(error.fields().at("code").string_value(), "INVALID_ARGUMENT");
  EXPECT_THAT(error.fields().at("message").string_value(), HasSubstr("no command trian"));

  EXPECT_THAT(ErrorOf(Maneuver({"--output", "json", "predict", "/nowhere/scene.json"}).err)
                  .fields()
                  .at("message")
                  .string_value(),
              HasSubstr("/nowhere/scene.json"));
}

TEST(CommandErrorsTest, WithJsonOutputBytesOfAPathThatAreNoUtf8AreReplaced) {
  const Result result = Maneuver({"--output", "json", "predict", "/nowhere/caf\xe9.json"});
  EXPECT_THAT(ErrorOf(result.err).fields().at("message").string_value(),
              HasSubstr("/nowhere/caf\ufffd.json"));
}

TEST(CommandErrorsTest, ReportsAnExportAsJson) {
  const TemporaryFolder folder;
  v1::TrainingSettings settings;
  const v1::ModelSpec spec = artifact::ResolveTrainingSettings(settings).model();
  ASSERT_TRUE(artifact::WriteModelFolder(folder / "model", inference::RandomModel(spec, 1)).ok());
  const std::string file = folder / "networks.onnx";
  const Result result =
      Maneuver({"model", "export", folder / "model", "--onnx", file, "--output", "json"});
  EXPECT_EQ(result.status, kOk);
  google::protobuf::Struct written;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(result.out, &written).ok()) << result.out;
  EXPECT_EQ(written.fields().at("file").string_value(), file);
  EXPECT_EQ(written.fields().at("sizeBytes").number_value(),
            static_cast<double>(std::filesystem::file_size(file)));
}

TEST(PrintableTest, EscapesControlCharactersOnly) {
  EXPECT_EQ(Printable("a\x1b[31mred\x07\n\x7f"), "a\\x1b[31mred\\x07\\x0a\\x7f");
  EXPECT_EQ(Printable("\xc2\x9b"
                      "2J"),
            "\\u009b2J");  // CSI in one character
  EXPECT_EQ(Printable("Straße, 20 °C – 30 °C"), "Straße, 20 °C – 30 °C");
  EXPECT_EQ(Printable("a\u202egnp\u2066\u2028b"), "a\\u202egnp\\u2066\\u2028b")
      << "text that shows as other text";
  EXPECT_EQ(PrintableLines("one\ntwo\r"), "one\ntwo\\x0d");
}

TEST(PrintableTest, TablesAndErrorsContainNoControlCharacters) {
  Table table({{"A\x1b[2J"}});
  table.Add({"b\nc"});
  EXPECT_EQ(table.Text(false), "A\\x1b[2J\nb\\x0ac\n");

  client::TestServer server;
  server.on_predict = [](auto*, const auto&, auto*) {
    return grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, "scene \x1b]0;owned\x07");
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "predict", "-"}, kScene).err,
            "maneuver: scene \\x1b]0;owned\\x07\n");
}

TEST(PrintableTest, MessagesContainNoControlCharacters) {
  client::TestServer server;
  bool truncated = false;
  server.on_predict = [&](auto*, const auto&, v1::PredictResponse* response) {
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->set_scenario_id("scene\x1b[2J");
    prediction->mutable_joint()->set_truncated(truncated);
    return grpc::Status::OK;
  };
  for (const bool each : {false, true}) {
    truncated = each;
    EXPECT_THAT(
        Maneuver({"--server", server.address(), "predict", "-", "--joint", "6"}, kScene).err,
        HasSubstr("scene\\x1b[2J: "));
  }
  server.on_train = [](const v1::TrainRequest&, v1::Job* job) {
    job->set_name("jobs/3f2a");
    job->set_state(v1::JOB_STATE_PENDING);
    job->mutable_error()->set_message("no server has a GPU\x1b[2J");
    return grpc::Status::OK;
  };
  EXPECT_THAT(
      Maneuver({"--server", server.address(), "train", "town", "--dataset", "town", "--detach"})
          .err,
      HasSubstr("no server has a GPU\\x1b[2J\n"));
}

// A server that shows this certificate, on a free port.
class TlsServer {
 public:
  // client_ca: authority of the client certificates that it requires, PEM; empty: it requires none.
  explicit TlsServer(const TestCertificate& certificate, const std::string& client_ca = "") {
    grpc::SslServerCredentialsOptions options;
    if (!client_ca.empty()) {
      options.pem_root_certs = client_ca;
      options.client_certificate_request =
          GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY;
    }
    options.pem_key_cert_pairs.push_back({certificate.key, certificate.certificate});
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::SslServerCredentials(options), &port_);
    builder.RegisterService(&service_);
    server_ = builder.BuildAndStart();
  }
  ~TlsServer() { server_->Shutdown(std::chrono::system_clock::now()); }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  v1::PredictionService::Service service_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

class TlsErrorsTest : public ::testing::Test {
 protected:
  TlsErrorsTest() { WriteText(ca_, authority_.certificate()); }

  // What `maneuver health` says, and what this process writes on its standard error meanwhile.
  std::string Health(const std::string& address, const std::string& ca) {
    return Health({"--server", address, "--tls-ca", ca});
  }
  std::string Health(std::vector<std::string> arguments) {
    arguments.emplace_back("health");
    ::testing::internal::CaptureStderr();
    const Result result = Maneuver(arguments);
    EXPECT_THAT(::testing::internal::GetCapturedStderr(), IsEmpty());
    EXPECT_EQ(result.status, kFailed);
    EXPECT_THAT(result.err, Not(HasSubstr("no server answers")));
    return result.err;
  }

  // Writes a client's certificate and key, and returns the options that name them.
  std::vector<std::string> Present(const TestCertificate& certificate) {
    WriteText(folder_ / "client.crt", certificate.certificate);
    WriteText(folder_ / "client.key", certificate.key);
    return {"--tls-ca",          ca_,
            "--tls-certificate", folder_ / "client.crt",
            "--tls-key",         folder_ / "client.key"};
  }

  const TemporaryFolder folder_;
  TestAuthority authority_{"Test authority"};
  const std::string ca_ = folder_ / "ca.crt";
};

TEST_F(TlsErrorsTest, SaysThatACertificateIsOfAnotherAuthority) {
  const TlsServer server(authority_.Issue("server", "IP:127.0.0.1"));
  const std::string other = folder_ / "other.crt";
  WriteText(other, TestAuthority("Other authority").certificate());
  EXPECT_THAT(Health(server.address(), other),
              AllOf(HasSubstr("is not trusted: it is from another authority"), HasSubstr(other)));
}

TEST_F(TlsErrorsTest, SaysThatACertificateHasExpired) {
  const TlsServer server(authority_.Issue("server", "IP:127.0.0.1", -3));
  EXPECT_THAT(Health(server.address(), ca_), HasSubstr("is not trusted: it has expired"));
}

TEST_F(TlsErrorsTest, SaysThatACertificateIsForAnotherName) {
  const TlsServer server(authority_.Issue("server", "DNS:planner.example"));
  EXPECT_THAT(Health(server.address(), ca_),
              AllOf(HasSubstr("is for another name"), HasSubstr("--tls-server-name")));
}

TEST_F(TlsErrorsTest, SaysThatAServerUsesPlainText) {
  const client::TestServer server;
  EXPECT_THAT(Health(server.address(), ca_),
              AllOf(HasSubstr("does not serve over TLS"), Not(HasSubstr("SSL_ERROR"))));
}

TEST_F(TlsErrorsTest, SaysThatAServerUsesTls) {
  const TlsServer server(authority_.Issue("server", "IP:127.0.0.1"));
  EXPECT_THAT(Health({"--server", server.address()}), HasSubstr("serves over TLS; add --tls-ca"));
}

TEST_F(TlsErrorsTest, SaysThatAServerRequiresAClientCertificate) {
  TestAuthority clients("Clients");
  const TlsServer server(authority_.Issue("server", "IP:127.0.0.1"), clients.certificate());
  EXPECT_THAT(Health(server.address(), ca_), HasSubstr("requires a client certificate"));

  std::vector<std::string> stranger = Present(authority_.Issue("client", ""));
  stranger.insert(stranger.end(), {"--server", server.address()});
  EXPECT_THAT(Health(stranger), AllOf(HasSubstr("refuses the client certificate in"),
                                      HasSubstr((folder_ / "client.crt").string())));
}

TEST_F(TlsErrorsTest, SaysThatAKeyIsNotTheCertificates) {
  Present(authority_.Issue("client", ""));
  const std::string certificate = folder_ / "client.crt";
  const std::string key = folder_ / "client.key";
  WriteText(key, authority_.Issue("other", "").key);
  const auto client = client::Client::Connect(
      {.address = kNobody, .tls = client::TlsOptions{ca_, certificate, key}});
  EXPECT_EQ(client.status(), absl::InvalidArgumentError(absl::StrCat(
                                 key, " is not the key of the certificate in ", certificate)));
}

}  // namespace
}  // namespace maneuver::cli::command_errors_test
