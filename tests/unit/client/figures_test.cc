#include "client/cli/figures.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/command.h"
#include "maneuver/v1/dataset_service.grpc.pb.h"
#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::figures_test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::UnorderedElementsAre;

void Straight(double x, double y, v1::Trajectory* trajectory) {
  for (const double share : {0.5, 1.0}) {
    trajectory->add_x(share * x);
    trajectory->add_y(share * y);
  }
}

// The server's part of the figures: two actions, and any recording of any dataset.
class Models final : public v1::ModelService::Service {
  grpc::Status GetActionSet(grpc::ServerContext*, const v1::GetActionSetRequest* request,
                            v1::ActionSet* response) override {
    response->set_model_version(request->name());
    for (const double end : {10.0, 30.0}) {
      v1::Action* action = response->add_actions();
      action->set_action_id(response->actions_size() - 1);
      action->set_effective(true);
      Straight(end, 0.0, action->mutable_distribution()->mutable_mean_trajectory());
    }
    return grpc::Status::OK;
  }
};

class Datasets final : public v1::DatasetService::Service {
 public:
  bool forget = false;

 private:
  grpc::Status GetScenario(grpc::ServerContext*, const v1::GetScenarioRequest* request,
                           v1::Scenario* response) override {
    if (forget) return {grpc::StatusCode::NOT_FOUND, "there is no such recording"};
    response->set_scenario_id(request->scenario_id());
    response->add_target_ids(99);
    v1::Agent* agent = response->add_agents();
    agent->set_id(7);
    agent->set_length(4.0);
    agent->set_width(2.0);
    for (int i = 0; i < 8; ++i) {
      agent->add_states()->set_time(i);
      agent->mutable_states(i)->set_x(5.0 * i);
    }
    return grpc::Status::OK;
  }
};

class Predictions final : public v1::PredictionService::Service {
 public:
  std::vector<v1::PredictRequest> requests() {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

 private:
  grpc::Status Predict(grpc::ServerContext*, const v1::PredictRequest* request,
                       v1::PredictResponse* response) override {
    const std::lock_guard lock(mutex_);
    requests_.push_back(*request);
    v1::TargetPrediction* target = response->add_predictions()->add_targets();
    target->set_target_id(request->scenarios(0).target_ids(0));
    v1::ActionDistribution* action = target->add_distributions();
    action->set_probability(0.9);
    Straight(10.0, 0.0, action->mutable_mean_trajectory());
    response->add_waypoint_times(2.0);
    return grpc::Status::OK;
  }

  std::mutex mutex_;
  std::vector<v1::PredictRequest> requests_;
};

class FiguresTest : public testing::Test {
 protected:
  FiguresTest() {
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&models_);
    builder.RegisterService(&datasets_);
    builder.RegisterService(&predictions_);
    server_ = builder.BuildAndStart();
    environment_.server = "127.0.0.1:" + std::to_string(port);

    report_.set_model_version("models/town/versions/2");
    report_.set_dataset("datasets/unseen");
    report_.add_reliability()->set_examples(1);
    AddExample("left", 20.0, 30.0, 0.99);
    AddExample("right", 20.0, -30.0, 0.99);
    AddExample("far", 60.0, 1.0, 0.99);
    AddExample("dull", 10.0, 0.0, 0.99);
    AddExample("open", 20.0, 0.0, 0.5);
  }
  ~FiguresTest() override { server_->Shutdown(std::chrono::system_clock::now()); }

  void AddExample(const std::string& scenario, double x, double y, double probability) {
    v1::EvaluatedExample* example = report_.add_sampled_examples();
    example->set_scenario_id(scenario);
    example->set_target_id(7);
    example->set_time(3.0);
    Straight(x, y, example->mutable_trajectory());
    for (const double p : {probability, 1.0 - probability}) {
      example->add_probabilities(p);
      example->add_responsibilities(p);
    }
  }

  Models models_;
  Datasets datasets_;
  Predictions predictions_;
  std::unique_ptr<grpc::Server> server_;
  std::istringstream in_;
  std::ostringstream out_;
  std::ostringstream err_;
  Environment environment_{in_, out_, err_};
  const TemporaryFolder parent_;
  const std::filesystem::path folder_ = parent_ / "figures";
  v1::EvaluationReport report_;
};

TEST_F(FiguresTest, DrawsAllFiguresWithTheFarthestAndTheMostAmbiguousScenes) {
  ASSERT_EQ(DrawFigures(report_, folder_.string(), environment_), kOk) << err_.str();
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
    files.push_back(entry.path().filename().string());
    std::string start(4, ' ');
    std::ifstream(entry.path(), std::ios::binary).read(start.data(), 4);
    EXPECT_EQ(start, "\x89PNG") << files.back();
  }
  EXPECT_THAT(files, UnorderedElementsAre("actions.png", "action-means.png", "reliability.png",
                                          "scene-left.png", "scene-right.png", "scene-far.png",
                                          "scene-open.png"));
  std::vector<std::string> asked;
  for (const v1::PredictRequest& request : predictions_.requests()) {
    EXPECT_EQ(request.model(), "models/town/versions/2");
    const v1::Scenario& scenario = request.scenarios(0);
    asked.push_back(scenario.scenario_id() +
                    (request.query().source() == v1::LATENT_SOURCE_PRIOR ? " generic" : ""));
    EXPECT_EQ(scenario.prediction_time(), 3.0);
    EXPECT_THAT(scenario.target_ids(), ElementsAre(7));
    EXPECT_EQ(scenario.agents(0).states_size(), 4);  // nothing of what came later
  }
  EXPECT_THAT(asked, ElementsAre("left generic", "left", "right generic", "right", "far generic",
                                 "far", "open generic", "open"));
}

TEST_F(FiguresTest, ReportsAFigureThatCannotBeDrawnAndDrawsTheOthers) {
  datasets_.forget = true;
  EXPECT_EQ(DrawFigures(report_, folder_.string(), environment_), kFailed);
  EXPECT_THAT(err_.str(), HasSubstr("there is no such recording"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "action-means.png"));
  EXPECT_TRUE(std::filesystem::exists(folder_ / "reliability.png"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "scene-left.png"));
}

}  // namespace
}  // namespace maneuver::cli::figures_test
