// maneuver model show and actions, against a server that answers as each test says.

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/maneuver.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::model_command_test {
namespace {

using testing::ContainsRegex;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

// Serves one version. Its only action keeps half of the speed, if it is relative, for 2 s; it ends
// 30 m ahead if it is not.
class Models final : public v1::ModelService::Service {
 public:
  bool relative = true;
  v1::ModelVersion version;
  std::map<std::string, v1::ModelVersion> named;  // in place of `version`, by what is asked for
  std::vector<std::optional<double>> speeds;      // that were asked for
  std::string labelled;                           // the version of the last label
  std::string removed;                            // the last alias that was to be deleted
  grpc::Status removal;                           // what that is answered with

 private:
  // Has models/town.
  grpc::Status ListModelVersions(grpc::ServerContext*, const v1::ListModelVersionsRequest* request,
                                 v1::ListModelVersionsResponse* response) override {
    if (request->parent() == "models/town" || request->parent() == "models/-") {
      response->add_model_versions()->set_name("models/town/versions/2");
    }
    return grpc::Status::OK;
  }
  grpc::Status GetActionSet(grpc::ServerContext*, const v1::GetActionSetRequest* request,
                            v1::ActionSet* response) override {
    speeds.push_back(request->has_speed() ? std::optional(request->speed()) : std::nullopt);
    response->set_model_version("models/town/versions/2");
    response->add_waypoint_times(2.0);
    v1::Action& action = *response->add_actions();
    action.set_effective(true);
    action.set_display_name("brake");
    const double speed = request->has_speed() ? request->speed() : 10.0;
    if (relative) response->set_speed(speed);
    v1::Trajectory& mean = *action.mutable_distribution()->mutable_mean_trajectory();
    mean.add_x(relative ? speed : 30.0);
    mean.add_y(0.0);
    return grpc::Status::OK;
  }
  grpc::Status GetModelVersion(grpc::ServerContext*, const v1::GetModelVersionRequest* request,
                               v1::ModelVersion* response) override {
    const auto found = named.find(request->name());
    *response = found == named.end() ? version : found->second;
    return grpc::Status::OK;
  }
  // Sends one file, model.json: "{}".
  grpc::Status DownloadModelVersion(
      grpc::ServerContext*, const v1::DownloadModelVersionRequest*,
      grpc::ServerWriter<v1::DownloadModelVersionResponse>* writer) override {
    v1::DownloadModelVersionResponse message;
    message.mutable_header()->set_model_version("models/town/versions/2");
    v1::ModelFile& file = *message.mutable_header()->add_files();
    file.set_file("model.json");
    file.set_size_bytes(2);
    file.set_sha256("44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a");
    writer->Write(message);
    message.set_chunk("{}");
    writer->Write(message);
    return grpc::Status::OK;
  }
  grpc::Status SetModelAlias(grpc::ServerContext*, const v1::SetModelAliasRequest* request,
                             v1::ModelAlias* response) override {
    response->set_name(request->name());
    response->set_model_version(request->model_version());
    return grpc::Status::OK;
  }
  grpc::Status DeleteModelAlias(grpc::ServerContext*, const v1::DeleteModelAliasRequest* request,
                                google::protobuf::Empty*) override {
    removed = request->name();
    return removal;
  }
  grpc::Status LabelAction(grpc::ServerContext*, const v1::LabelActionRequest* request,
                           v1::Action* response) override {
    labelled = request->name();
    response->set_action_id(request->action_id());
    response->set_label(request->label());
    return grpc::Status::OK;
  }
  grpc::Status ListEvaluationReports(grpc::ServerContext*, const v1::ListEvaluationReportsRequest*,
                                     v1::ListEvaluationReportsResponse*) override {
    return grpc::Status::OK;
  }
};

class ModelCommandTest : public testing::Test {
 protected:
  ModelCommandTest() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&models_);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  ~ModelCommandTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  // What the command printed.
  std::string Run(std::vector<std::string> arguments, int status = kOk) {
    arguments.insert(arguments.begin(), {"--server", address_});
    std::istringstream in;
    std::ostringstream out;
    Environment environment(in, out, out);
    EXPECT_EQ(RunManeuver(arguments, environment), status) << out.str();
    return out.str();
  }

  Models models_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

TEST_F(ModelCommandTest, ShowsWhatAModelReadsAndPredicts) {
  v1::ModelSpec& spec = *models_.version.mutable_manifest()->mutable_spec();
  spec.mutable_scene_vectors()->set_path_width(96);
  spec.mutable_scene_vectors()->set_agent_width(64);
  spec.set_reference(v1::TRAJECTORY_REFERENCE_FADING_MOTION);
  spec.mutable_action_geometry()->set_pair_width(32);
  spec.set_mean_residual(true);
  spec.mutable_scene_covariance();
  spec.mutable_trajectory()->set_waypoints(125);
  spec.mutable_trajectory()->mutable_waypoint_interval()->set_nanos(100'000'000);
  std::string shown = Run({"model", "show", "town/2"});
  EXPECT_THAT(shown, ContainsRegex("predicts +vehicles"));
  EXPECT_THAT(shown, ContainsRegex("horizon +12\\.5 s in 125 waypoints"));
  EXPECT_THAT(shown, ContainsRegex("trajectories +relative to the present motion"));
  EXPECT_THAT(shown, ContainsRegex("vectors +the target's past second, lane paths, agents nearby"));
  EXPECT_THAT(shown, ContainsRegex("actions look at +the lane paths"));
  EXPECT_THAT(shown, ContainsRegex("means +also depend on the scene directly"));
  EXPECT_THAT(shown, ContainsRegex("covariance +predicted from the scene"));
  EXPECT_THAT(shown, Not(HasSubstr("raster")));
  EXPECT_THAT(shown, Not(HasSubstr("backbone")));

  spec.Clear();
  spec.mutable_raster()->set_width(96);
  spec.mutable_raster()->set_height(64);
  spec.mutable_raster()->set_meters_per_pixel(0.5);
  spec.add_target_types(v1::AGENT_TYPE_CYCLIST);
  shown = Run({"model", "show", "town/2"});
  EXPECT_THAT(shown, ContainsRegex("predicts +cyclists"));
  EXPECT_THAT(shown, ContainsRegex("trajectories +in metres"));
  EXPECT_THAT(shown, ContainsRegex("raster +96 x 64 at 0.5 m a pixel"));
  EXPECT_THAT(shown, HasSubstr("backbone"));
  EXPECT_THAT(shown, Not(HasSubstr("vectors")));
}

TEST_F(ModelCommandTest, PullsIntoNoFolderWithoutAName) {
  EXPECT_THAT(Run({"model", "pull", "town/2", ""}, kFailed),
              HasSubstr("cannot download into the folder \"\": Invalid argument"));
}

TEST_F(ModelCommandTest, AFolderWithMoreThanTheVersionIsNotTheVersion) {
  const TemporaryFolder folder;
  const std::string pulled = folder / "town-2";
  EXPECT_THAT(Run({"model", "pull", "town/2", pulled}), HasSubstr("is town/2"));
  EXPECT_THAT(Run({"model", "pull", "town/2", pulled}), HasSubstr("is town/2"));
  WriteBytes(folder / "town-2/baselines.json", "{}");
  EXPECT_THAT(Run({"model", "pull", "town/2", pulled}, kFailed),
              HasSubstr("exists already and is not models/town/versions/2"));
}

TEST_F(ModelCommandTest, LabelsTheVersionThatAModelServes) {
  models_.version.set_name("models/town/versions/2");
  for (const char* model : {"town", "town@candidate", "town/2"}) {
    models_.labelled.clear();
    EXPECT_THAT(Run({"model", "label", model, "7", "left\x1b[31m"}),
                HasSubstr("action 7 of town/2 is now \"left\\x1b[31m\""));
    EXPECT_EQ(models_.labelled, "models/town/versions/2");
  }
}

// A version whose effective actions end so many metres ahead after 5 s.
v1::ModelVersion VersionOf(const std::string& name,
                           const std::vector<std::pair<std::string, double>>& actions) {
  v1::ModelVersion version;
  version.set_name(name);
  v1::ModelManifest& manifest = *version.mutable_manifest();
  manifest.mutable_spec()->mutable_trajectory()->set_waypoints(1);
  manifest.mutable_spec()->mutable_trajectory()->mutable_waypoint_interval()->set_seconds(5);
  for (const auto& [title, ahead] : actions) {
    v1::Action& action = *manifest.add_actions();
    action.set_action_id(manifest.actions_size() - 1);
    action.set_effective(true);
    action.set_usage(0.5);
    action.set_display_name(title);
    action.mutable_distribution()->mutable_mean_trajectory()->add_x(ahead);
    action.mutable_distribution()->mutable_mean_trajectory()->add_y(0.0);
  }
  return version;
}

TEST_F(ModelCommandTest, PromotionListsWhichOldActionIsWhichNewOne) {
  models_.named["models/town@serving"] =
      VersionOf("models/town/versions/1", {{"stop", 12.0}, {"cruise", 50.0}});
  models_.named["models/town/versions/2"] = VersionOf(
      "models/town/versions/2", {{"keep straight", 49.0}, {"reverse", -9.0}, {"wait", 11.5}});
  EXPECT_THAT(Run({"model", "promote", "town/2"}),
              HasSubstr("models/town/aliases/serving is now models/town/versions/2\n"
                        "\n"
                        "What its actions are now:\n"
                        "\n"
                        "town/1  NAME              town/2  NAME           APART\n"
                        "     0  stop                   2  wait           0.5 m\n"
                        "     1  cruise                 0  keep straight  1.0 m\n"
                        "     -  (no such action)       1  reverse            -\n"));
}

TEST_F(ModelCommandTest, PromotingTheServingVersionListsNoActions) {
  models_.named["models/town@serving"] = VersionOf("models/town/versions/2", {{"stop", 12.0}});
  models_.named["models/town/versions/2"] = models_.named["models/town@serving"];
  EXPECT_EQ(Run({"model", "promote", "town/2"}),
            "models/town/aliases/serving is now models/town/versions/2\n");
}

TEST_F(ModelCommandTest, PromotionSaysWhyActionsCannotBeMatched) {
  models_.named["models/town@serving"] = VersionOf("models/town/versions/1", {{"stop", 12.0}});
  v1::ModelVersion longer = VersionOf("models/town/versions/2", {{"stop", 12.0}});
  longer.mutable_manifest()
      ->mutable_spec()
      ->mutable_trajectory()
      ->mutable_waypoint_interval()
      ->set_seconds(8);
  models_.named["models/town/versions/2"] = longer;
  EXPECT_THAT(Run({"model", "promote", "town/2"}),
              HasSubstr("The actions of town/1 and town/2 cannot be matched: the models' waypoints "
                        "are not at the same times"));
}

TEST_F(ModelCommandTest, ListsActionsByTheirDisplayNames) {
  EXPECT_THAT(Run({"model", "actions", "town"}),
              ContainsRegex("ACTION +NAME +USAGE.*\n +0 +brake "));
}

TEST_F(ModelCommandTest, FailsToListAModelThatDoesNotExist) {
  EXPECT_THAT(Run({"model", "list", "town"}), HasSubstr("town/2"));
  EXPECT_EQ(
      Run({"model", "list", "twon"}, kFailed),
      "maneuver: there is no version of twon; maneuver model list shows those of all models\n");
}

TEST_F(ModelCommandTest, PromotionNeedsBothADatasetAndARequirement) {
  EXPECT_THAT(Run({"model", "promote", "town/2", "--dataset", "unseen"}, kUsage),
              HasSubstr("--dataset needs --ahead-of or --not-behind"));
  EXPECT_THAT(Run({"model", "promote", "town/2", "--ahead-of", "cv"}, kUsage),
              HasSubstr("--ahead-of and --not-behind need --dataset"));
}

TEST_F(ModelCommandTest, RequiresTheVersionToDelete) {
  EXPECT_THAT(Run({"model", "delete", "town@candidate"}, kUsage),
              HasSubstr("name the version to delete, such as town/2; see maneuver model list"));
}

TEST_F(ModelCommandTest, RemovesAnAliasAndSaysWhatItWas) {
  models_.named["models/town@candidate"].set_name("models/town/versions/2");
  for (const char* alias :
       {"town@candidate", "models/town@candidate", "models/town/aliases/candidate"}) {
    models_.removed.clear();
    EXPECT_EQ(Run({"model", "unalias", alias}),
              "models/town/aliases/candidate is removed; it was models/town/versions/2\n");
    EXPECT_EQ(models_.removed, "models/town/aliases/candidate");
  }
  EXPECT_EQ(Run({"--output", "json", "model", "unalias", "town@candidate"}),
            "{\n"
            " \"name\": \"models/town/aliases/candidate\",\n"
            " \"modelVersion\": \"models/town/versions/2\"\n"
            "}\n");
}

TEST_F(ModelCommandTest, SaysThatNoVersionServesWithoutTheAlias) {
  models_.named["models/town@serving"].set_name("models/town/versions/2");
  EXPECT_THAT(Run({"model", "unalias", "town@serving"}),
              HasSubstr("no version of town serves now; maneuver model promote town/2 makes one "
                        "serve\n"));
}

TEST_F(ModelCommandTest, RequiresTheAliasToRemove) {
  for (const char* no_alias : {"town", "town/2"}) {
    EXPECT_EQ(Run({"model", "unalias", no_alias}, kUsage),
              "maneuver: name the alias to remove, such as town@candidate; see maneuver model "
              "list\n");
  }
  EXPECT_EQ(models_.removed, "");
}

TEST_F(ModelCommandTest, FailsToRemoveAnAliasThatTheServerDoesNotKnow) {
  models_.removal = {
      grpc::StatusCode::NOT_FOUND,
      "there is no models/town/aliases/candidat; models/town has candidate, serving"};
  EXPECT_EQ(Run({"model", "unalias", "town@candidat"}, kFailed),
            "maneuver: there is no models/town/aliases/candidat; models/town has candidate, "
            "serving\n");
}

TEST_F(ModelCommandTest, DrawsActionsAtTheRequestedSpeed) {
  EXPECT_THAT(Run({"model", "actions", "town"}),
              AllOf(HasSubstr("10.0 m ahead"), HasSubstr("at 10 m/s")));
  EXPECT_THAT(Run({"model", "actions", "town", "--speed", "7.5"}),
              AllOf(HasSubstr("7.5 m ahead"), HasSubstr("at 7.5 m/s")));
  EXPECT_THAT(models_.speeds, ElementsAre(std::nullopt, 7.5));
}

TEST_F(ModelCommandTest, SaysIfTheSpeedMakesNoDifference) {
  models_.relative = false;
  EXPECT_THAT(Run({"model", "actions", "town", "--speed", "7.5"}),
              AllOf(HasSubstr("30.0 m ahead"), HasSubstr("the same at every speed")));
}

TEST_F(ModelCommandTest, DrawsAGalleryOfRelativeActionsAtFourSpeeds) {
  const TemporaryFolder folder;
  const std::string gallery = folder / "gallery.png";
  Run({"model", "actions", "town", "--plot", gallery});
  EXPECT_THAT(models_.speeds, ElementsAre(std::nullopt, 0.0, 5.0, 10.0, 20.0));
  EXPECT_GT(std::filesystem::file_size(gallery), 1000U);
  models_.speeds.clear();
  Run({"model", "actions", "town", "--plot", folder / "one.png", "--speed", "3"});
  EXPECT_THAT(models_.speeds, ElementsAre(3.0));
  models_.relative = false;
  models_.speeds.clear();
  Run({"model", "actions", "town", "--plot", folder / "metres.png"});
  EXPECT_THAT(models_.speeds, ElementsAre(std::nullopt));
}

}  // namespace
}  // namespace maneuver::cli::model_command_test
