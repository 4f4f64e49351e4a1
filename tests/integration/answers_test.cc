// Tests the whole path with real processes: town, upload, training through the Train RPC, and
// answers.

#include <gmock/gmock.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <numeric>
#include <set>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::answers_test {
namespace {

using ::testing::HasSubstr;

// Asks one server with a trained model, which all tests share.
class AnswersTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { trained_ = std::make_unique<TrainedServer>(); }
  static void TearDownTestSuite() { trained_.reset(); }

  static ServerProcess& server() { return trained_->server(); }

  static std::unique_ptr<v1::PredictionService::Stub> Predictions() {
    return v1::PredictionService::NewStub(server().channel());
  }

  static v1::PredictRequest Request(int first, int count) {
    v1::PredictRequest request;
    request.set_model("models/tiny");
    for (int i = first; i < first + count; ++i) *request.add_scenarios() = trained_->unseen()[i];
    return request;
  }

  static grpc::Status Predict(const v1::PredictRequest& request, v1::PredictResponse* response) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
    return Predictions()->Predict(&context, request, response);
  }

  static std::unique_ptr<TrainedServer> trained_;
};

std::unique_ptr<TrainedServer> AnswersTest::trained_;

TEST_F(AnswersTest, ProbabilitiesOfEachAnswerSumToOne) {
  v1::PredictActionProbabilitiesRequest request;
  for (const v1::Scenario& scenario : trained_->unseen()) *request.add_scenarios() = scenario;
  v1::PredictActionProbabilitiesResponse response;
  grpc::ClientContext context;
  const grpc::Status status =
      Predictions()->PredictActionProbabilities(&context, request, &response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(response.model_version(), "models/tiny/versions/1");
  int targets = 0;
  for (const v1::ScenarioPrediction& prediction : response.predictions()) {
    EXPECT_FALSE(prediction.has_error()) << prediction.error().message();
    for (const v1::TargetPrediction& target : prediction.targets()) {
      ASSERT_EQ(target.probabilities_size(), 12);
      const double sum =
          std::accumulate(target.probabilities().begin(), target.probabilities().end(), 0.0);
      EXPECT_NEAR(sum, 1.0, 1e-5);
      ++targets;
    }
  }
  EXPECT_GT(targets, 12);
}

TEST_F(AnswersTest, DistributionsHaveEveryRequestedPart) {
  v1::PredictRequest request = Request(0, 1);
  request.mutable_query()->set_top_k(3);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  ASSERT_EQ(response.waypoint_times_size(), 10);
  EXPECT_NEAR(response.waypoint_times(9), 4.0, 1e-9);
  const v1::TargetPrediction& target = response.predictions(0).targets(0);
  ASSERT_EQ(target.distributions_size(), 3);
  double last = 1.0;
  for (const v1::ActionDistribution& action : target.distributions()) {
    EXPECT_EQ(action.probability(), target.probabilities(action.action_id()));
    EXPECT_LE(action.probability(), last);
    last = action.probability();
    EXPECT_EQ(action.latent_mean_size(), 3);
    EXPECT_EQ(action.latent_stddev_size(), 3);
    EXPECT_EQ(action.mean_trajectory().x_size(), 10);
    ASSERT_EQ(action.sigma_trajectories_size(), 7);
    EXPECT_EQ(action.sigma_trajectories(0).x(9), action.mean_trajectory().x(9));
    ASSERT_EQ(action.moments().covariance_xx_size(), 10);
    for (int t = 0; t < 10; ++t) {
      const double determinant =
          action.moments().covariance_xx(t) * action.moments().covariance_yy(t) -
          std::pow(action.moments().covariance_xy(t), 2);
      EXPECT_GT(determinant, 0.0);
    }
  }
}

TEST_F(AnswersTest, DescribesNoActionBelowTheProbabilityThreshold) {
  v1::PredictRequest request = Request(0, 1);
  request.mutable_query()->set_min_probability(1.0);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  const v1::TargetPrediction& target = response.predictions(0).targets(0);
  EXPECT_GT(target.probabilities_size(), 0);
  EXPECT_EQ(target.distributions_size(), 0);
}

// Compares the medoid with its definition, using all actions of the same answer.
TEST_F(AnswersTest, TheMedoidHasTheLeastExpectedDistanceToTheMixture) {
  v1::PredictRequest request = Request(0, 4);
  request.mutable_query()->set_min_probability(0.0);
  request.mutable_query()->set_representatives(3);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  for (const v1::ScenarioPrediction& prediction : response.predictions()) {
    for (const v1::TargetPrediction& target : prediction.targets()) {
      ASSERT_EQ(target.distributions_size(), 12);
      // Waypoints are 0.4 s apart: all of them count.
      const auto expected_distance = [&](const v1::Trajectory& from) {
        double sum = 0.0;
        for (const v1::ActionDistribution& other : target.distributions()) {
          for (int t = 0; t < from.x_size(); ++t) {
            sum += other.probability() * std::hypot(from.x(t) - other.mean_trajectory().x(t),
                                                    from.y(t) - other.mean_trajectory().y(t));
          }
        }
        return sum / from.x_size();
      };
      ASSERT_EQ(target.representatives_size(), 3);
      double medoid = HUGE_VAL;
      double least = HUGE_VAL;
      for (const v1::ActionDistribution& action : target.distributions()) {
        const double distance = expected_distance(action.mean_trajectory());
        least = std::min(least, distance);
        if (action.action_id() == target.representatives(0).action_id()) medoid = distance;
      }
      EXPECT_NEAR(medoid, least, 0.01);  // negligible actions are left out of the choice
      double weights = 0.0;
      for (const v1::Representative& each : target.representatives()) weights += each.weight();
      EXPECT_NEAR(weights, 1.0, 1e-9);
    }
  }
}

TEST_F(AnswersTest, DescribesRepresentativesEvenIfNoActionIsSelected) {
  v1::PredictRequest request = Request(0, 1);
  request.mutable_query()->set_min_probability(1.0);
  request.mutable_query()->set_representatives(4);
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(request, &response).ok());
  const v1::TargetPrediction& target = response.predictions(0).targets(0);
  ASSERT_EQ(target.representatives_size(), 4);
  std::set<int> represented, described;
  for (const auto& each : target.representatives()) represented.insert(each.action_id());
  for (const auto& each : target.distributions()) described.insert(each.action_id());
  EXPECT_EQ(described, represented);
  EXPECT_EQ(described.size(), 4u);
}

TEST_F(AnswersTest, WorldAndTargetFramesAgree) {
  v1::PredictRequest request = Request(0, 1);
  request.mutable_scenarios(0)->mutable_target_ids()->Truncate(1);
  v1::PredictResponse world;
  ASSERT_TRUE(Predict(request, &world).ok());
  request.mutable_query()->set_frame(v1::FRAME_TARGET);
  v1::PredictResponse local;
  ASSERT_TRUE(Predict(request, &local).ok());

  const v1::Scenario& scenario = request.scenarios(0);
  const v1::AgentState* pose = nullptr;
  for (const v1::Agent& agent : scenario.agents()) {
    if (agent.id() != scenario.target_ids(0)) continue;
    for (const v1::AgentState& state : agent.states()) {
      if (std::abs(state.time() - scenario.prediction_time()) < 0.01) pose = &state;
    }
  }
  ASSERT_NE(pose, nullptr);
  const auto& w = world.predictions(0).targets(0).distributions(0).mean_trajectory();
  const auto& l = local.predictions(0).targets(0).distributions(0).mean_trajectory();
  const double heading = pose->heading();
  for (int t = 0; t < w.x_size(); ++t) {
    EXPECT_NEAR(w.x(t), pose->x() + std::cos(heading) * l.x(t) - std::sin(heading) * l.y(t), 1e-4);
    EXPECT_NEAR(w.y(t), pose->y() + std::sin(heading) * l.x(t) + std::cos(heading) * l.y(t), 1e-4);
  }
}

TEST_F(AnswersTest, AnswersHaveTheSameBitsAloneInABatchAndAfterARestart) {
  v1::PredictResponse batch;
  ASSERT_TRUE(Predict(Request(0, 8), &batch).ok());
  v1::PredictResponse alone;
  ASSERT_TRUE(Predict(Request(5, 1), &alone).ok());
  v1::ScenarioPrediction in_batch = batch.predictions(5);
  in_batch.set_scenario_index(0);
  EXPECT_EQ(in_batch.SerializeAsString(), alone.predictions(0).SerializeAsString());

  trained_->Restart();
  v1::PredictResponse later;
  ASSERT_TRUE(Predict(Request(0, 8), &later).ok());
  EXPECT_EQ(batch.SerializeAsString(), later.SerializeAsString());
}

TEST_F(AnswersTest, IgnoresStatesAfterThePredictionTime) {
  v1::PredictRequest request = Request(0, 4);
  v1::PredictResponse with_future;
  ASSERT_TRUE(Predict(request, &with_future).ok());
  for (v1::Scenario& scenario : *request.mutable_scenarios()) {
    for (v1::Agent& agent : *scenario.mutable_agents()) {
      while (agent.states_size() > 0 &&
             agent.states(agent.states_size() - 1).time() > scenario.prediction_time() + 1e-6) {
        agent.mutable_states()->RemoveLast();
      }
    }
  }
  v1::PredictResponse without_future;
  ASSERT_TRUE(Predict(request, &without_future).ok());
  EXPECT_EQ(with_future.SerializeAsString(), without_future.SerializeAsString());
}

TEST_F(AnswersTest, ClassifiesADrivenTrajectory) {
  v1::ClassifyTrajectoriesRequest request;
  *request.add_scenarios() = trained_->unseen()[0];
  v1::ClassifyTrajectoriesResponse response;
  grpc::ClientContext context;
  const grpc::Status status = Predictions()->ClassifyTrajectories(&context, request, &response);
  ASSERT_TRUE(status.ok()) << status.error_message();
  int classified = 0;
  for (const v1::TargetClassification& target : response.classifications(0).targets()) {
    if (target.has_error()) continue;
    const double sum =
        std::accumulate(target.responsibilities().begin(), target.responsibilities().end(), 0.0);
    EXPECT_NEAR(sum, 1.0, 1e-5);
    EXPECT_TRUE(std::isfinite(target.log_likelihood_bound()));
    ++classified;
  }
  EXPECT_GT(classified, 0);
}

TEST_F(AnswersTest, AStreamAnswersEachRequestByItsId) {
  grpc::ClientContext context;
  auto stream = Predictions()->StreamPredict(&context);
  constexpr int kRequests = 20;
  for (int i = 0; i < kRequests; ++i) {
    v1::StreamPredictRequest request;
    request.set_request_id("r" + std::to_string(i));
    *request.mutable_request() = Request(i % 12, 1);
    if (i == 7) request.mutable_request()->set_model("models/nobody");
    ASSERT_TRUE(stream->Write(request));
  }
  stream->WritesDone();
  std::map<std::string, v1::StreamPredictResponse> responses;
  v1::StreamPredictResponse response;
  while (stream->Read(&response)) responses[response.request_id()] = response;
  ASSERT_TRUE(stream->Finish().ok());
  ASSERT_EQ(responses.size(), kRequests);
  EXPECT_EQ(responses["r7"].error().code(), grpc::StatusCode::NOT_FOUND);
  v1::PredictResponse direct;
  ASSERT_TRUE(Predict(Request(3, 1), &direct).ok());
  EXPECT_EQ(responses["r3"].response().SerializeAsString(), direct.SerializeAsString());
}

// One way to make a scenario invalid, and the field that the error must name.
struct BadInput {
  const char* name;
  std::function<void(v1::Scenario&)> spoil;
  const char* field;
};

TEST_F(AnswersTest, NamesBadInputAndAnswersTheRestOfTheBatch) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<BadInput> cases = {
      {"non-finite state",
       [=](v1::Scenario& s) { s.mutable_agents(0)->mutable_states(3)->set_x(kNan); },
       "scenarios[1].agents[0].states[3].x"},
      {"non-finite time", [=](v1::Scenario& s) { s.set_prediction_time(kNan); },
       "scenarios[1].prediction_time"},
      {"negative size", [](v1::Scenario& s) { s.mutable_agents(1)->set_length(-4.0); },
       "scenarios[1].agents[1].length"},
      {"unordered times",
       [](v1::Scenario& s) {
         auto* states = s.mutable_agents(0)->mutable_states();
         states->SwapElements(1, 2);
       },
       "scenarios[1].agents[0].states[2].time"},
      {"map point", [=](v1::Scenario& s) { s.mutable_map_features(0)->set_y(1, kNan); },
       "scenarios[1].map_features[0].y[1]"},
      {"unequal x and y", [](v1::Scenario& s) { s.mutable_map_features(0)->add_x(1.0); },
       "scenarios[1].map_features[0]"},
      {"unknown target", [](v1::Scenario& s) { s.set_target_ids(0, 987654); },
       "scenarios[1].target_ids[0]"},
      {"target absent at the prediction time",
       [](v1::Scenario& s) {
         for (v1::Agent& agent : *s.mutable_agents()) {
           if (agent.id() != s.target_ids(0)) continue;
           for (v1::AgentState& state : *agent.mutable_states()) {
             state.set_time(state.time() + 1000.0);
           }
         }
       },
       "scenarios[1].target_ids[0]"},
      {"too many states",
       [](v1::Scenario& s) {
         auto* agent = s.mutable_agents(0);
         for (int i = 0; i < 100'000; ++i) {
           auto* state = agent->add_states();
           state->set_time(1e4 + i);
         }
       },
       "scenarios[1].agents[0].states"},
  };
  v1::PredictResponse good;
  ASSERT_TRUE(Predict(Request(0, 3), &good).ok());
  for (const BadInput& bad : cases) {
    SCOPED_TRACE(bad.name);
    v1::PredictRequest request = Request(0, 3);
    bad.spoil(*request.mutable_scenarios(1));
    v1::PredictResponse response;
    const grpc::Status status = Predict(request, &response);
    ASSERT_TRUE(status.ok()) << status.error_message();
    ASSERT_EQ(response.predictions_size(), 3);
    const v1::ScenarioPrediction& spoiled = response.predictions(1);
    const v1::Status& error = spoiled.has_error() ? spoiled.error() : spoiled.targets(0).error();
    EXPECT_EQ(error.code(), grpc::StatusCode::INVALID_ARGUMENT);
    v1::BadRequest details;
    bool found = false;
    for (const auto& any : error.details()) {
      if (any.type_url() != "type.googleapis.com/google.rpc.BadRequest") continue;
      ASSERT_TRUE(details.ParseFromString(any.value()));
      for (const auto& violation : details.field_violations()) {
        found = found || violation.field().starts_with(bad.field);
      }
    }
    EXPECT_TRUE(found) << error.message() << "\n" << details.DebugString();
    for (const int other : {0, 2}) {
      EXPECT_EQ(response.predictions(other).SerializeAsString(),
                good.predictions(other).SerializeAsString());
    }
  }
  EXPECT_TRUE(server().Alive());
}

TEST_F(AnswersTest, EvaluationAgreesWithRecordedManoeuvres) {
  auto training = v1::TrainingService::NewStub(server().channel());
  v1::EvaluateRequest request;
  request.set_model("models/tiny");
  request.set_dataset("datasets/unseen");
  request.set_sampled_examples(20);
  v1::Job job;
  {
    grpc::ClientContext context;
    const grpc::Status status = training->Evaluate(&context, request, &job);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  grpc::ClientContext context;
  v1::WatchJobRequest watch;
  watch.set_name(job.name());
  auto reader = training->WatchJob(&context, watch);
  v1::WatchJobResponse event;
  while (reader->Read(&event)) job = event.job();
  ASSERT_TRUE(reader->Finish().ok());
  ASSERT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.error().message();
  const auto& metrics = job.evaluation().metrics();
  for (const auto& [name, value] : metrics) std::printf("%s %.3f\n", name.c_str(), value);
  // This model is tiny and trained for seconds. The quickstart's must reach more.
  EXPECT_GT(metrics.at("nmi"), 0.3);
  EXPECT_GE(metrics.at("effective_actions"), 5);
  EXPECT_LT(metrics.at("min_fde_6"), metrics.at("fde_cv"));
  ASSERT_EQ(job.evaluation().sampled_examples_size(), 20);
  EXPECT_EQ(job.evaluation().sampled_examples(0).probabilities_size(),
            job.evaluation().action_uses_size());
}

// Adds another version of the model, with a residual backbone, beside the serving one.
TEST_F(AnswersTest, TrainsShowsAndServesAResidualBackbone) {
  v1::TrainingSettings settings;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(kTinySettings, &settings).ok());
  v1::BackboneSpec& backbone = *settings.mutable_model()->mutable_backbone();
  backbone.clear_convolutions();
  ASSERT_TRUE(google::protobuf::TextFormat::ParseFromString(
      R"pb(stem { channels: 8 kernel_size: 7 stride: 2 max_pool: true }
           block: RESIDUAL_BLOCK_BOTTLENECK
           stages { blocks: 2 width: 4 stride: 1 }
           stages { blocks: 2 width: 8 stride: 2 })pb",
      backbone.mutable_residual()));
  settings.mutable_examples()->mutable_stride()->set_seconds(3);
  settings.mutable_optimization()->set_pretraining_epochs(1);
  settings.mutable_optimization()->set_mixture_epochs(1);
  settings.mutable_optimization()->set_joint_epochs(1);
  std::string json;
  ASSERT_TRUE(google::protobuf::util::MessageToJsonString(settings, &json).ok());
  const std::filesystem::path file = trained_->folder() / "residual.json";
  std::ofstream(file) << json;

  std::string output;
  ASSERT_EQ(RunManeuver(server(),
                        {"train", "tiny", "--dataset", "town", "--settings", file.string(),
                         "--promote", "never"},
                        &output),
            0)
      << output;
  ASSERT_EQ(RunManeuver(server(), {"model", "show", "tiny/2"}, &output), 0) << output;
  EXPECT_THAT(output, HasSubstr("multiply-adds a target"));

  v1::PredictRequest request = Request(0, 3);
  request.set_model("models/tiny/versions/2");
  v1::PredictResponse together;
  ASSERT_TRUE(Predict(request, &together).ok());
  EXPECT_EQ(together.model_version(), "models/tiny/versions/2");
  for (int i = 0; i < 3; ++i) {
    v1::PredictRequest alone = Request(i, 1);
    alone.set_model("models/tiny/versions/2");
    v1::PredictResponse response;
    ASSERT_TRUE(Predict(alone, &response).ok());
    const v1::ScenarioPrediction& prediction = response.predictions(0);
    ASSERT_GT(prediction.targets_size(), 0);
    ASSERT_EQ(prediction.targets_size(), together.predictions(i).targets_size());
    for (int t = 0; t < prediction.targets_size(); ++t) {
      EXPECT_TRUE(prediction.targets(t).SerializeAsString() ==
                  together.predictions(i).targets(t).SerializeAsString());
    }
  }
  EXPECT_EQ(RunManeuver(server(), {"model", "delete", "tiny/2"}, &output), 0) << output;
}

// Flips one byte of the weights, far from the header.
void Alter(const std::filesystem::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekg(-100, std::ios::end);
  const auto position = stream.tellg();
  const char byte = static_cast<char>(stream.get());
  stream.seekp(position);
  stream.put(static_cast<char>(byte ^ 0x40));
}

TEST_F(AnswersTest, RefusesADamagedVersionAndKeepsServing) {
  const std::filesystem::path models = trained_->data_dir() / "models" / "tiny";
  for (const char* version : {"7", "8"}) {
    std::filesystem::copy(models / "1", models / version, std::filesystem::copy_options::recursive);
  }
  Alter(models / "7" / "weights.safetensors");
  std::filesystem::resize_file(models / "8" / "weights.safetensors", 1000);
  trained_->Restart();

  auto service = v1::ModelService::NewStub(server().channel());
  for (const char* version : {"7", "8"}) {
    grpc::ClientContext context;
    v1::SetModelAliasRequest request;
    request.set_name("models/tiny/aliases/serving");
    request.set_model_version(std::string("models/tiny/versions/") + version);
    v1::ModelAlias alias;
    const grpc::Status status = service->SetModelAlias(&context, request, &alias);
    EXPECT_FALSE(status.ok()) << "version " << version << " was accepted";
    EXPECT_THAT(status.error_message(), HasSubstr("weights.safetensors"));
  }
  v1::PredictResponse response;
  ASSERT_TRUE(Predict(Request(0, 1), &response).ok());
  EXPECT_EQ(response.model_version(), "models/tiny/versions/1");
  for (const char* version : {"7", "8"}) std::filesystem::remove_all(models / version);
  trained_->Restart();
}

TEST_F(AnswersTest, StopsCleanlyOnSigterm) {
  EXPECT_EQ(server().Terminate(), 0);
  trained_->Restart();
}

}  // namespace
}  // namespace maneuver::integration::answers_test
