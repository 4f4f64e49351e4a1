#include "client/cli/command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "client/cli/job_display.h"
#include "client/cli/maneuver.h"
#include "client/cli/progress_line.h"
#include "client/cli/resource_names.h"
#include "client/cli/rival_option.h"
#include "client/cli/settings_argument.h"
#include "client/cli/table.h"
#include "client/cli/target_selection.h"
#include "client/cli/text_format.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/onnx/onnx_export.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/client/test_server.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::command_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

TEST(ModelExportTest, WritesTheNetworksOfAFolder) {
  const TemporaryFolder work;
  v1::TrainingSettings settings;
  const v1::ModelSpec spec = artifact::ResolveTrainingSettings(settings).model();
  ASSERT_EQ(artifact::WriteModelFolder(work / "model", inference::RandomModel(spec, 1)),
            absl::OkStatus());
  const auto stored = artifact::ReadModelFolder(work / "model");
  ASSERT_EQ(stored.status(), absl::OkStatus());
  for (const bool distributions : {true, false}) {
    const std::string file = work / "networks.onnx";
    std::vector<std::string> arguments = {"model", "export", work / "model", "--onnx", file};
    if (!distributions) {
      arguments.insert(arguments.end(), {"--probabilities-only", "--scenes", "7"});
    }
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kOk) << result.err;
    EXPECT_THAT(result.out, HasSubstr(file));
    std::stringstream written;
    written << std::ifstream(file, std::ios::binary).rdbuf();
    EXPECT_TRUE(written.str() == onnx::ExportOnnx(*stored, {distributions, distributions ? 0 : 7}));
  }
}

// "town/3" names a version on the server, where a folder is wanted.
TEST(ModelExportTest, WithoutAModelFolderItSaysHowToGetOne) {
  const Result result = Maneuver({"model", "export", "town/3", "--onnx", "/nowhere/file"});
  EXPECT_EQ(result.status, kUsage);
  EXPECT_THAT(result.err, HasSubstr("town/3 is not a model folder"));
  EXPECT_THAT(result.err, HasSubstr("maneuver model pull town/3 FOLDER"));
}

TEST(CommandLineTest, RefusesContradictoryPromotionOptions) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--promote", "if-no-worse"}, "needs --promote-dataset"},
      {{"--promote-dataset", "unseen"}, "need --promote if-no-worse"},
      {{"--promote-ahead", "cv"}, "need --promote if-no-worse"},
      {{"--promote", "if-no-worse", "--promote-dataset", "unseen", "--promote-ahead", "nobody"},
       "--promote-ahead nobody: nobody is none of cv"},
      {{"--promote", "always", "--promote-metric", "nll"}, "need --promote if-no-worse"},
      {{"--promote", "if-no-worse", "--promote-dataset", "unseen", "--promote-metric",
        "nll=little"},
       "not nll=little"}};
  for (const auto& [options, says] : cases) {
    std::vector<std::string> arguments = {"train", "town", "--dataset", "town"};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kUsage) << says;
    EXPECT_THAT(result.err, HasSubstr(says));
  }
}

TEST(CommandLineTest, MistakesEndWithStatusTwoAndAHint) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {},
           {"fly"},
           {"dataset"},
           {"dataset", "upload", "folder"},
           {"train", "town"},
           {"synthesize", "out", "--recordings", "0"},
           {"synthesize", "out", "--recordings", "many"},
           {"model", "list", "--output", "xml"},
           {"model", "compare", "town/1"},
           {"predict", "x.json", "--top-k", "0"},
           {"predict", "x.json", "--representatives", "0"},
           {"predict", "x.json", "--joint", "65"},
           {"predict", "x.json", "--top-k", "1", "--actions", "2"},
           {"predict", "x.json", "--paths"},
           {"scenario", "show", "town", "a", "--paths"},
           {"scenario", "extract", "town", "a", "--wrong"}}) {
    const Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kUsage) << testing::PrintToString(arguments);
    EXPECT_THAT(result.out, IsEmpty());
    EXPECT_THAT(result.err, HasSubstr("--help"));
  }
}

// Expects an example in the help of each command below this one. Returns how many there are.
int ExpectExamples(const std::vector<std::string>& path) {
  std::vector<std::string> arguments = path;
  arguments.push_back("--help");
  const Result result = Maneuver(arguments);
  EXPECT_EQ(result.status, kOk);
  const size_t list = result.out.find("Subcommands:\n");
  if (list == std::string::npos) {
    EXPECT_THAT(result.out, HasSubstr("Example:")) << testing::PrintToString(path);
    return 1;
  }
  int commands = 0;
  std::istringstream lines(result.out.substr(list));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line) && line.starts_with("  ")) {
    if (line.starts_with("   ")) continue;  // the rest of a summary
    std::vector<std::string> below = path;
    below.push_back(line.substr(2, line.find(' ', 2) - 2));
    commands += ExpectExamples(below);
  }
  return commands;
}

TEST(CommandLineTest, HelpOfEveryCommandHasAnExample) { EXPECT_GT(ExpectExamples({}), 50); }

TEST(CommandLineTest, InvalidFilesEndWithStatusTwo) {
  EXPECT_EQ(Maneuver({"predict", "/nowhere/scene.json"}).status, kUsage);
  const Result garbage = Maneuver({"predict", "-"}, "{\"agents\": 5}");
  EXPECT_EQ(garbage.status, kUsage);
  EXPECT_THAT(garbage.err, HasSubstr("standard input is not a Scenario"));
  const Result untargeted = Maneuver({"probability", "-"}, "{\"scenarioId\": \"a\"}");
  EXPECT_EQ(untargeted.status, kUsage);
  EXPECT_THAT(untargeted.err, HasSubstr("names no target"));
  EXPECT_EQ(Maneuver({"train", "town", "--dataset", "town", "--set", "model.wings=2"}).status,
            kUsage);
}

TEST(CommandLineTest, NamesAServerThatDoesNotAnswerAndSaysWhatToDo) {
  // Port 1 of this machine: nobody listens.
  const Result result = Maneuver({"--server", "127.0.0.1:1", "health"});
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.out, IsEmpty());
  EXPECT_THAT(result.err, HasSubstr("no server answers at 127.0.0.1:1; start one with maneuverd "
                                    "--data-dir DIR, name it with --server"));
}

TEST(CommandLineTest, PredictSendsItsPriority) {
  client::TestServer server;
  std::vector<v1::Priority> asked;
  server.on_predict = [&](grpc::ServerContext*, const v1::PredictRequest& request,
                          v1::PredictResponse*) {
    asked.push_back(request.priority());
    return grpc::Status::OK;
  };
  const std::string scene = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";
  std::vector<std::string> arguments = {"--server", server.address(), "predict", "-"};
  EXPECT_EQ(Maneuver(arguments, scene).status, kOk);
  arguments.insert(arguments.end(), {"--priority", "bulk"});
  EXPECT_EQ(Maneuver(arguments, scene).status, kOk);
  EXPECT_THAT(asked, ElementsAre(v1::PRIORITY_INTERACTIVE, v1::PRIORITY_BULK));
  arguments.back() = "urgent";
  EXPECT_EQ(Maneuver(arguments, scene).status, kUsage);
}

TEST(CommandLineTest, PredictShowsTheRequestedRepresentatives) {
  client::TestServer server;
  int asked = -1;
  server.on_predict = [&](grpc::ServerContext*, const v1::PredictRequest& request,
                          v1::PredictResponse* response) {
    asked = request.query().representatives();
    for (const char* name : {"keep speed", "brake", "drift left"}) {
      if (request.include_action_names()) response->add_action_names(name);
    }
    response->add_waypoint_times(5.0);
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->set_scenario_id("scene");
    v1::TargetPrediction* target = prediction->add_targets();
    target->set_target_id(7);
    for (const int id : {3, 1}) {
      v1::ActionDistribution* action = target->add_distributions();
      action->set_action_id(id);
      action->mutable_mean_trajectory()->add_x(10.0 * id);
      action->mutable_mean_trajectory()->add_y(-2.0);
    }
    for (int i = 0; i < asked; ++i) {
      v1::Representative* representative = target->add_representatives();
      representative->set_action_id(2 * i + 1);
      representative->set_weight(i == 0 ? 0.75 : 0.25);
    }
    return grpc::Status::OK;
  };
  const std::string scene = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";
  std::vector<std::string> arguments = {"--server", server.address(), "predict", "-"};
  EXPECT_THAT(Maneuver(arguments, scene).out, Not(HasSubstr("REPRESENTATIVE")));
  EXPECT_EQ(asked, 0);
  arguments.insert(arguments.end(), {"--representatives", "2"});
  EXPECT_THAT(
      Maneuver(arguments, scene).out,
      HasSubstr("SCENARIO  TARGET  REPRESENTATIVE  ACTION  NAME   WEIGHT  AFTER 5 s (world)\n"
                "scene          7      1 (medoid)       1  brake  75.0 %       10.0, -2.0 m\n"
                "                               2       3         25.0 %       30.0, -2.0 m\n"));
  EXPECT_EQ(asked, 2);
  arguments.insert(arguments.end(), {"--output", "json"});
  EXPECT_THAT(Maneuver(arguments, scene).out,
              AllOf(HasSubstr("\"representatives\""), HasSubstr("\"drift left\"")));
}

TEST(CommandLineTest, PredictShowsTheCombinationsOfActions) {
  client::TestServer server;
  v1::JointPrediction joint;
  server.on_predict = [&](grpc::ServerContext*, const v1::PredictRequest& request,
                          v1::PredictResponse* response) {
    for (const char* name : {"keep speed", "brake"}) response->add_action_names(name);
    response->add_waypoint_times(5.0);
    v1::ScenarioPrediction* prediction = response->add_predictions();
    prediction->set_scenario_id("scene");
    for (const int id : {7, 12}) prediction->add_targets()->set_target_id(id);
    if (request.query().joint_combinations() > 0) *prediction->mutable_joint() = joint;
    return grpc::Status::OK;
  };
  const auto add = [&](int first, int second, double probability, double weight) {
    v1::JointCombination* combination = joint.add_combinations();
    combination->add_action_ids(first);
    combination->add_action_ids(second);
    combination->set_log_probability(std::log(probability));
    combination->set_weight(weight);
  };
  joint.add_target_ids(7);
  joint.add_target_ids(12);
  add(0, 1, 0.3, 0.75);
  add(1, 0, 0.1, 0.25);
  const std::string scene = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";
  std::vector<std::string> arguments = {"--server", server.address(), "predict", "-"};
  EXPECT_THAT(Maneuver(arguments, scene).out, Not(HasSubstr("COMBINATION")));
  arguments.insert(arguments.end(), {"--joint", "6"});
  EXPECT_THAT(
      Maneuver(arguments, scene).out,
      HasSubstr("SCENARIO  COMBINATION  WEIGHT  PROBABILITY  TARGET  ACTION  NAME\n"
                "scene               1  75.0 %       30.0 %       7       0  keep speed\n"
                "                                                12       1  brake\n"
                "                    2  25.0 %       10.0 %       7       1  brake\n"
                "                                                12       0  keep speed\n"));
  joint.set_truncated(true);
  EXPECT_THAT(Maneuver(arguments, scene).err,
              HasSubstr("scene: the search for combinations ended at its bound, with 2 of them"));
  joint.set_truncated(false);
  joint.clear_combinations();
  const Result none = Maneuver(arguments, scene);
  EXPECT_THAT(none.err,
              HasSubstr("scene: two targets would collide in every combination of actions"));
  EXPECT_THAT(none.out, Not(HasSubstr("COMBINATION")));
}

TEST(CommandLineTest, PredictSendsRequiredNamesAndSaysWhichAreGone) {
  client::TestServer server;
  std::vector<std::string> required;
  server.on_predict = [&](grpc::ServerContext*, const v1::PredictRequest& request,
                          v1::PredictResponse*) -> grpc::Status {
    required.assign(request.required_action_names().begin(), request.required_action_names().end());
    return {
        grpc::StatusCode::FAILED_PRECONDITION,
        "required_action_names: models/town/versions/2 has no action named \"left turn, tight\""};
  };
  const std::string scene = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";
  // Each option has one value: the file behind it is still the scene.
  const Result result = Maneuver({"--server", server.address(), "predict", "--require-name",
                                  "left turn, tight", "--require-name", "brake", "-"},
                                 scene);
  EXPECT_THAT(required, ElementsAre("left turn, tight", "brake"));
  EXPECT_EQ(result.status, kFailed);
  EXPECT_THAT(result.err, HasSubstr("no action named \"left turn, tight\""));
}

TEST(CommandLineTest, ADetachedJobIsNamedWithTheCommandThatWatchesIt) {
  client::TestServer server;
  const auto start = [](v1::Job* job) {
    job->set_name("jobs/3f2a");
    job->set_state(v1::JOB_STATE_PENDING);
    job->mutable_error()->set_message("no server has a GPU");
  };
  server.on_start_job = start;
  server.on_train = [&](const v1::TrainRequest&, v1::Job* job) {
    start(job);
    return grpc::Status::OK;
  };
  const std::string hint = "Watch it with: maneuver job watch 3f2a\n";
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"train", "town", "--dataset", "town"},
           {"evaluate", "town", "--dataset", "unseen"},
           {"cross-validate", "town"},
           {"recalibrate", "town", "--dataset", "unseen"},
           {"tag", "unseen", "--model", "town", "--on-server", "june"}}) {
    std::vector<std::string> arguments = {"--server", server.address()};
    arguments.insert(arguments.end(), command.begin(), command.end());
    arguments.emplace_back("--detach");
    Result result = Maneuver(arguments);
    EXPECT_EQ(result.status, kOk) << command.front();
    EXPECT_EQ(result.out, "jobs/3f2a\n") << command.front();
    EXPECT_EQ(result.err, "jobs/3f2a waits: no server has a GPU\n" + hint) << command.front();
    arguments.emplace_back("--output=json");
    result = Maneuver(arguments);
    EXPECT_THAT(result.out, HasSubstr("\"jobs/3f2a\"")) << command.front();
    EXPECT_THAT(result.err, Not(HasSubstr("Watch"))) << command.front();
  }
  const Result resumed =
      Maneuver({"--server", server.address(), "job", "resume", "3f2a", "--detach"});
  EXPECT_EQ(resumed.out, "jobs/3f2a is pending\n");
  EXPECT_EQ(resumed.err, hint);
}

TEST(CommandLineTest, CtrlCStopsWatchingWithStatus130) {
  client::TestServer server;
  const auto start = [](v1::Job* job) { job->set_name("jobs/3f2a"); };
  server.on_start_job = start;
  server.on_train = [&](const v1::TrainRequest&, v1::Job* job) {
    start(job);
    return grpc::Status::OK;
  };
  std::atomic<bool> is_over = false;
  server.on_watch = [&](const v1::WatchJobRequest&, auto*) {
    kill(getpid(), SIGINT);
    while (!is_over) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return grpc::Status(grpc::StatusCode::CANCELLED, "");
  };
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"job", "watch", "3f2a"},
           {"train", "town", "--dataset", "town"},
           {"evaluate", "town", "--dataset", "unseen", "--figures", "/tmp"}}) {
    std::signal(SIGINT, SIG_DFL);  // whatever the shell has set
    is_over = false;
    std::vector<std::string> arguments = {"--server", server.address()};
    arguments.insert(arguments.end(), command.begin(), command.end());
    const Result result = Maneuver(arguments);
    is_over = true;
    EXPECT_EQ(result.status, kInterrupted) << command.front();
    EXPECT_THAT(result.err, HasSubstr("Stopped watching; jobs/3f2a continues."));
    if (command.front() == "evaluate") {
      EXPECT_THAT(result.err, HasSubstr("maneuver job show 3f2a --figures /tmp\n"));
    }
  }
}

// The words after an option's value belong to the command.
TEST(CommandLineTest, AnOptionThatMayBeRepeatedTakesOneValueEachTime) {
  client::TestServer server;
  std::vector<int32_t> actions;
  server.on_predict = [&](grpc::ServerContext*, const v1::PredictRequest& request,
                          v1::PredictResponse*) {
    const auto& ids = request.query().action_ids().ids();
    actions.assign(ids.begin(), ids.end());
    return grpc::Status::OK;
  };
  server.on_start_job = [](v1::Job* job) { job->set_name("jobs/3f2a"); };
  std::vector<std::string> datasets;
  server.on_train = [&](const v1::TrainRequest& request, v1::Job* job) {
    datasets.assign(request.datasets().begin(), request.datasets().end());
    job->set_name("jobs/3f2a");
    return grpc::Status::OK;
  };
  const std::string scene = R"({"agents": [{"id": 7, "states": [{}]}], "targetIds": [7]})";
  Result result =
      Maneuver({"--server", server.address(), "predict", "--actions", "1,2", "-"}, scene);
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(actions, ElementsAre(1, 2));
  result = Maneuver({"--server", server.address(), "cross-validate", "--test-dataset", "ngsim",
                     "town", "--detach"});
  EXPECT_EQ(result.status, kOk) << result.err;
  result = Maneuver({"--server", server.address(), "train", "--dataset", "a", "--dataset", "b",
                     "town", "--detach"});
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(datasets, ElementsAre("datasets/a", "datasets/b"));
}

TEST(CommandLineTest, HelpMarksARequiredOption) {
  EXPECT_THAT(Maneuver({"outcomes", "report", "--help"}).out,
              testing::ContainsRegex("--model TEXT REQUIRED"));
  EXPECT_THAT(Maneuver({"import", "argoverse", "--help"}).out,
              testing::ContainsRegex("--maps TEXT REQUIRED"));
}

TEST(CommandLineTest, EvaluateSendsItsPriority) {
  client::TestServer server;
  int32_t asked = 0;
  server.on_evaluate = [&](const v1::EvaluateRequest& request, v1::Job*) {
    asked = request.priority();
    return grpc::Status::OK;
  };
  EXPECT_EQ(Maneuver({"--server", server.address(), "evaluate", "town", "--dataset", "unseen",
                      "--priority", "10", "--detach"})
                .status,
            kOk);
  EXPECT_EQ(asked, 10);
}

TEST(CommandLineTest, ADetachedEvaluationSaysHowToDrawItsFigures) {
  client::TestServer server;
  server.on_start_job = [](v1::Job* job) { job->set_name("jobs/3f2a"); };
  const Result result = Maneuver({"--server", server.address(), "evaluate", "town", "--dataset",
                                  "unseen", "--figures", "drawn", "--detach"});
  EXPECT_EQ(result.status, kOk) << result.err;
  EXPECT_THAT(result.err, HasSubstr("maneuver job show 3f2a --figures drawn\n"));
}

TEST(CommandLineTest, ValidatingARequestCreatesNoFolder) {
  const TemporaryFolder folder;
  const std::string drawn = folder / "drawn";
  client::TestServer server;
  server.on_start_job = [](v1::Job*) {};
  server.on_train = [](const v1::TrainRequest&, v1::Job*) { return grpc::Status::OK; };
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"evaluate", "town", "--dataset", "unseen", "--figures", drawn},
           {"train", "town", "--dataset", "town", "--tensorboard", drawn}}) {
    std::vector<std::string> arguments = {"--server", server.address()};
    arguments.insert(arguments.end(), command.begin(), command.end());
    arguments.emplace_back("--validate-only");
    EXPECT_EQ(Maneuver(arguments).status, kOk) << command.front();
    EXPECT_FALSE(std::filesystem::exists(drawn)) << command.front();
  }
}

TEST(CommandLineTest, GlobalOptionsMayFollowTheCommand) {
  EXPECT_THAT(Maneuver({"health", "--server", "127.0.0.1:1"}).err, HasSubstr("127.0.0.1:1"));
}

TEST(ResourceNamesTest, ShortNamesBecomeFullOnes) {
  EXPECT_EQ(ModelResource("town"), "models/town");
  EXPECT_EQ(ModelResource("town@candidate"), "models/town@candidate");
  EXPECT_EQ(ModelResource("town/3"), "models/town/versions/3");
  EXPECT_EQ(ModelResource("models/town/versions/3"), "models/town/versions/3");
  EXPECT_EQ(ModelResource(""), "");
  EXPECT_EQ(DatasetResource("x"), "datasets/x");
  EXPECT_EQ(JobResource("jobs/y"), "jobs/y");
  EXPECT_EQ(ShortName("models/town/versions/3"), "town/3");
  EXPECT_EQ(ShortName("datasets/x"), "x");
}

TEST(SetFieldTest, SetsEveryKindOfField) {
  v1::TrainingSettings settings;
  for (const char* assignment :
       {"preset=paper", "seed=7", "optimization.learning_rate=5e-4", "optimization.joint_epochs=20",
        "model.decoder.hidden=500,500", "examples.stride=0.5s", "model.raster.frame_interval=0.25",
        "augmentation.mirror=false", "augmentation.scale=0",
        "model.backbone.convolutions=[{\"channels\": 32, \"stride\": 2}]",
        "model.latentDimensions=3", "model.objective=dual", "model.target_motion=false",
        "optimization.mixture_placement=MIXTURE_PLACEMENT_ENCODED_POINTS"}) {
    const absl::Status status = SetField(assignment, &settings);
    EXPECT_TRUE(status.ok()) << assignment << ": " << status;
  }
  EXPECT_EQ(settings.preset(), "paper");
  EXPECT_EQ(settings.seed(), 7);
  EXPECT_EQ(settings.model().objective(), v1::OBJECTIVE_DUAL);
  EXPECT_TRUE(settings.model().has_target_motion());
  EXPECT_EQ(settings.optimization().mixture_placement(), v1::MIXTURE_PLACEMENT_ENCODED_POINTS);
  EXPECT_EQ(settings.optimization().learning_rate(), 5e-4);
  EXPECT_EQ(settings.optimization().joint_epochs(), 20);
  EXPECT_THAT(settings.model().decoder().hidden(), ElementsAre(500, 500));
  EXPECT_EQ(ToSeconds(settings.examples().stride()), 0.5);
  EXPECT_EQ(ToSeconds(settings.model().raster().frame_interval()), 0.25);
  EXPECT_TRUE(settings.augmentation().has_mirror());
  EXPECT_FALSE(settings.augmentation().mirror());
  EXPECT_TRUE(settings.augmentation().has_scale());
  EXPECT_EQ(settings.model().backbone().convolutions(0).channels(), 32);
  EXPECT_EQ(settings.model().latent_dimensions(), 3);
  ASSERT_TRUE(SetField("model.decoder.hidden=64", &settings).ok());
  EXPECT_THAT(settings.model().decoder().hidden(), ElementsAre(64));  // replaced, not added to
}

TEST(SetFieldTest, AcceptsListsOfNamesWithoutTheirPrefix) {
  v1::TrainingSettings settings;
  for (const char* types : {"pedestrian,cyclist", "AGENT_TYPE_PEDESTRIAN, cyclist",
                            "[\"AGENT_TYPE_PEDESTRIAN\", \"AGENT_TYPE_CYCLIST\"]"}) {
    settings.Clear();
    ASSERT_TRUE(SetField(std::string("model.target_types=") + types, &settings).ok()) << types;
    EXPECT_THAT(settings.model().target_types(),
                ElementsAre(v1::AGENT_TYPE_PEDESTRIAN, v1::AGENT_TYPE_CYCLIST));
  }
  EXPECT_THAT(std::string(SetField("model.target_types=dog", &settings).message()),
              HasSubstr("a list, each vehicle, pedestrian, cyclist or other"));
}

TEST(SetFieldTest, MistakesListTheAcceptedValues) {
  v1::TrainingSettings settings;
  const auto message = [&](const char* assignment) {
    return std::string(SetField(assignment, &settings).message());
  };
  EXPECT_THAT(message("modle.actions=5"), HasSubstr("TrainingSettings has preset, model,"));
  EXPECT_THAT(message("model.actions=many"), HasSubstr("it takes a whole number"));
  EXPECT_THAT(message("model.objective=best"), HasSubstr("it takes base, dual or unified"));
  EXPECT_THAT(message("seed.low=1"), HasSubstr("seed has no fields"));
  EXPECT_THAT(message("seed"), HasSubstr("is not FIELD=VALUE"));
  EXPECT_THAT(message("examples.stride=soon"), HasSubstr("a duration such as 0.5s"));
}

TEST(SetHorizonTest, AHorizonBecomesANumberOfWaypoints) {
  v1::TrainingSettings settings;
  ASSERT_TRUE(SetField("model.trajectory.waypoint_interval=0.5s", &settings).ok());
  ASSERT_TRUE(SetHorizon("3s", &settings).ok());
  EXPECT_EQ(settings.model().trajectory().waypoints(), 6);
  EXPECT_FALSE(SetHorizon("3.2s", &settings).ok());
  EXPECT_FALSE(SetHorizon("-1", &settings).ok());
  EXPECT_FALSE(SetHorizon("soon", &settings).ok());
}

TEST(TableTest, AlignsColumnsWithoutTrailingSpaces) {
  Table table({{"NAME"}, {"SHARE", Align::kRight}, {"NOTE"}});
  table.Add({"a", "5.0 %", ""});
  table.Add({"Straße", "100.0 %", "wide"});
  EXPECT_EQ(table.Text(false),
            "NAME      SHARE  NOTE\n"
            "a         5.0 %\n"
            "Straße  100.0 %  wide\n");
  EXPECT_THAT(table.Text(true), HasSubstr("\x1b[1mNAME      SHARE  NOTE\x1b[0m\n"));
}

TEST(TextFormatTest, FormatsNumbersForPeople) {
  EXPECT_EQ(Spell(0.42), "0.4 s");
  EXPECT_EQ(Spell(59.4), "59 s");
  EXPECT_EQ(Spell(185), "3 min 05 s");
  EXPECT_EQ(Spell(7800), "2 h 10 min");
  EXPECT_EQ(Bytes(999), "999 B");
  EXPECT_EQ(Bytes(1'500'000), "1.5 MB");
  EXPECT_EQ(ExactSeconds(0.25), "0.25 s");
  EXPECT_EQ(ExactSeconds(30 * 0.1), "3 s");
  EXPECT_EQ(Share(0.1249), "12.5 %");
  EXPECT_EQ(HowMany(1, "recording"), "1 recording");
  EXPECT_EQ(HowMany(0, "recording"), "0 recordings");
  EXPECT_EQ(Bar(0.5, 4), "[##--]");
  EXPECT_EQ(Bar(2.0, 4), "[####]");
}

TEST(ProgressLineTest, ALineThatIsLongerThanTheTerminalDoesNotWrap) {
  std::ostringstream err;
  ProgressLine line(err, ProgressForm::kLine);
  line.Show(0.5, "joint 7/10");
  // Between turning the terminal's wrapping off and on again.
  EXPECT_EQ(err.str(), "\r\x1b[K\x1b[?7l[############------------] joint 7/10\x1b[?7h");
}

TEST(JobDisplayTest, ProgressOmitsWhatIsNotKnown) {
  v1::JobProgress progress;
  progress.set_phase("joint");
  progress.set_epoch(7);
  progress.set_epochs(10);
  progress.set_fraction(0.8);
  progress.mutable_time_left()->set_seconds(65);
  v1::EpochReport report;
  (*report.mutable_training())["loss"] = 2.3114;
  report.add_action_usage(1.0);
  report.set_effective_actions(19);
  EXPECT_EQ(ProgressText(progress, report),
            "joint 7/10  loss 2.311  19 effective actions  1 min 05 s left");
  (*report.mutable_validation())["loss"] = 2.5;
  progress.clear_time_left();
  EXPECT_EQ(ProgressText(progress, report),
            "joint 7/10  loss 2.311, held out 2.500  19 effective actions");
}

TEST(JobDisplayTest, EscapesTextOfTheServer) {
  v1::JobProgress progress;
  progress.set_phase("joint\x1b[2J");
  EXPECT_EQ(ProgressText(progress, {}), "joint\\x1b[2J");
  v1::Job job;
  job.set_model_version("models/town/versions/3");
  job.mutable_promotion_decision()->set_reason("worse\x1b[2J");
  EXPECT_EQ(PromotionText(job, false), "town/3 was not promoted: worse\\x1b[2J\n");
}

TEST(JobDisplayTest, ShowsMetricsBesideThoseOfConstantVelocity) {
  v1::ModelManifest manifest;
  auto& metrics = *manifest.mutable_metrics();
  metrics["ade_1"] = 1.25;
  metrics["min_ade_6"] = 0.5;
  metrics["ade_cv"] = 2.0;
  metrics["effective_actions"] = 19;
  EXPECT_EQ(HeldOutText(manifest, false),
            "ACCURACY   k = 1  k = 6    CV\n"
            "minADE, m   1.25   0.50  2.00\n"
            "\n"
            "ACTIONS    VALUE\n"
            "effective     19\n");

  v1::RivalStanding& all = *manifest.mutable_rivals()->add_parts();
  all.set_examples(60);
  v1::RivalComparison& comparison = *all.add_comparisons();
  comparison.set_metric("ade_1");
  comparison.set_rival("cv");
  comparison.mutable_difference()->set_value(-0.75);
  comparison.set_verdict(v1::RIVAL_VERDICT_AHEAD);
  EXPECT_THAT(HeldOutText(manifest, false), HasSubstr("ahead -0.75"));
}

TEST(RivalOptionTest, ParsesRequirementsAsRivalMetricAndScope) {
  google::protobuf::RepeatedPtrField<v1::RivalRequirement> requirements;
  ASSERT_TRUE(ParseRequirements({"cv", "ctra@strata", "baselines:min_fde_6@strata"},
                                v1::RIVAL_STANDARD_NOT_BEHIND, "--not-behind", &requirements)
                  .ok());
  ASSERT_EQ(requirements.size(), 4);
  EXPECT_EQ(requirements[0].rival(), "cv");
  EXPECT_EQ(requirements[0].metric(), "");
  EXPECT_EQ(requirements[0].standard(), v1::RIVAL_STANDARD_NOT_BEHIND);
  EXPECT_EQ(requirements[0].scope(), v1::RIVAL_SCOPE_ALL_EXAMPLES);
  EXPECT_EQ(requirements[1].rival(), "ctra");
  EXPECT_EQ(requirements[1].scope(), v1::RIVAL_SCOPE_EVERY_STRATUM);
  EXPECT_EQ(requirements[2].rival(), "covernet");
  EXPECT_EQ(requirements[3].rival(), "multipath");
  EXPECT_EQ(requirements[3].metric(), "min_fde_6");
  EXPECT_EQ(requirements[3].scope(), v1::RIVAL_SCOPE_EVERY_STRATUM);

  for (const auto& [text, wrong] : std::vector<std::pair<std::string, std::string>>{
           {"me", "me is none of cv"},
           {"cv:min_ade_6", "min_ade_6 cannot be compared with constant velocity"},
           {"cv@turns", "cv@turns is none of"}}) {
    const absl::Status status =
        ParseRequirements({text}, v1::RIVAL_STANDARD_AHEAD, "--ahead-of", &requirements);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr("--ahead-of " + text + ": " + wrong));
  }
}

// A vehicle at `speed` m/s along x, seen from `from` to `to` at 10 Hz.
void AddVehicle(int64_t id, double speed, double from, double to, v1::Scenario* scenario) {
  v1::Agent* agent = scenario->add_agents();
  agent->set_id(id);
  agent->set_type(v1::AGENT_TYPE_VEHICLE);
  for (int i = 0; from + 0.1 * i <= to + 1e-9; ++i) {
    v1::AgentState* state = agent->add_states();
    state->set_time(from + 0.1 * i);
    state->set_x(speed * 0.1 * i);
  }
}

TEST(TargetSelectionTest, SelectsMovingVehiclesWithAHistoryFastestFirst) {
  v1::Scenario scenario;
  AddVehicle(1, 5.0, 0.0, 9.0, &scenario);
  AddVehicle(2, 0.0, 0.0, 9.0, &scenario);  // stands
  AddVehicle(3, 8.0, 1.5, 9.0, &scenario);  // half a second of history
  AddVehicle(4, 12.0, 0.0, 9.0, &scenario);
  AddVehicle(5, 9.0, 0.0, 1.5, &scenario);  // gone
  AddVehicle(6, 9.0, 0.0, 9.0, &scenario);
  scenario.mutable_agents(5)->set_type(v1::AGENT_TYPE_CYCLIST);
  EXPECT_THAT(MovingAgents(scenario, v1::AGENT_TYPE_VEHICLE, 2.0, 8), ElementsAre(4, 1));
  EXPECT_THAT(MovingAgents(scenario, v1::AGENT_TYPE_VEHICLE, 2.0, 1), ElementsAre(4));
  EXPECT_THAT(MovingAgents(scenario, v1::AGENT_TYPE_CYCLIST, 2.0, 8), ElementsAre(6));
}

TEST(TargetSelectionTest, SelectsVisibleTargetsOfTheRecordingFirst) {
  v1::Scenario scenario;
  AddVehicle(1, 5.0, 0.0, 9.0, &scenario);
  AddVehicle(2, 9.0, 0.0, 1.5, &scenario);
  AddVehicle(3, 7.0, 0.0, 9.0, &scenario);
  scenario.add_target_ids(1);
  scenario.add_target_ids(2);
  EXPECT_THAT(DefaultTargets(scenario, v1::AGENT_TYPE_VEHICLE, 1.2), ElementsAre(1, 2));
  EXPECT_THAT(DefaultTargets(scenario, v1::AGENT_TYPE_VEHICLE, 5.0), ElementsAre(1));
  scenario.mutable_agents(0)->set_type(v1::AGENT_TYPE_PEDESTRIAN);
  EXPECT_THAT(DefaultTargets(scenario, v1::AGENT_TYPE_PEDESTRIAN, 1.2), ElementsAre(1));
  EXPECT_THAT(DefaultTargets(scenario, v1::AGENT_TYPE_VEHICLE, 1.2), ElementsAre(2));
  scenario.mutable_agents(0)->set_type(v1::AGENT_TYPE_VEHICLE);
  scenario.clear_target_ids();
  EXPECT_THAT(DefaultTargets(scenario, v1::AGENT_TYPE_VEHICLE, 5.0), ElementsAre(3, 1));
}

}  // namespace
}  // namespace maneuver::cli::command_test
