// Tests a real server that also asks the alias `candidate`: its metrics say how far the versions
// differ, and callers get unchanged answers.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "maneuver/v1/prediction_service.grpc.pb.h"
#include "model/artifact/model_folder.h"
#include "model/artifact/training_presets.h"
#include "model/data/town/synthetic_town.h"
#include "model/inference/action_model.h"
#include "tests/integration/metrics_page.h"
#include "tests/integration/trained_server.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::shadow_test {
namespace {

// The shadow yields to everything else on the machine, so it may take long.
constexpr std::chrono::seconds kPatience{100};

// Writes a model with random weights and with the actions that a trained model has.
void WriteModel(const std::filesystem::path& folder, const v1::ModelSpec& spec, uint32_t seed) {
  artifact::StoredModel model = inference::RandomModel(spec, seed);
  const auto loaded = inference::ActionModel::FromStored(model, {});
  ASSERT_TRUE(loaded.ok()) << loaded.status();
  const auto actions = static_cast<size_t>(spec.actions());
  const std::vector<double> usage(actions, 1.0 / static_cast<double>(actions));
  const auto effective = std::make_unique<bool[]>(actions);
  std::fill_n(effective.get(), actions, true);
  for (v1::Action& action :
       inference::DecodeActionSet(**loaded, usage, {effective.get(), actions})) {
    *model.manifest.add_actions() = std::move(action);
  }
  const auto status = artifact::WriteModelFolder(folder, model);
  ASSERT_TRUE(status.ok()) << status;
}

// models/tiny with two versions: 1 serves.
class ShadowTest : public ::testing::Test {
 protected:
  void SetUp() override {
    v1::TrainingSettings settings;
    ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(kTinySettings, &settings).ok());
    const v1::ModelSpec spec = artifact::ResolveTrainingSettings(settings).model();
    std::filesystem::create_directories(models());
    WriteModel(models() / "1", spec, 1);
    WriteModel(models() / "2", spec, 2);
    for (int i = 0; i < 2; ++i) {
      *request_.add_scenarios() = data::town::GenerateRecording({.seed = 1}, i).scenario;
      targets_ += request_.scenarios(i).target_ids_size();
    }
    request_.set_model("models/tiny");
    request_.mutable_query()->set_top_k(3);
    Start();
    Promote("tiny/1", "serving");
  }

  void Start() {
    server_ = nullptr;
    server_ = std::make_unique<ServerProcess>(
        folder_.path() / "data",
        std::vector<std::string>{"--workers", "1", "--shadow-fraction", "1"});
    predictions_ = v1::PredictionService::NewStub(server_->channel());
  }
  void Promote(const std::string& version, const std::string& alias) const {
    std::string output;
    ASSERT_EQ(RunManeuver(*server_, {"model", "promote", version, "--alias", alias}, &output), 0)
        << output;
  }

  // Returns the answers to every kind of request for the targets.
  std::string Ask() {
    std::string answers;
    v1::PredictResponse predicted;
    {
      grpc::ClientContext context;
      const auto status = predictions_->Predict(&context, request_, &predicted);
      EXPECT_TRUE(status.ok()) << status.error_message();
      answers += predicted.SerializeAsString();
    }
    {
      v1::PredictActionProbabilitiesRequest request;
      request.set_model(request_.model());
      *request.mutable_scenarios() = request_.scenarios();
      v1::PredictActionProbabilitiesResponse response;
      grpc::ClientContext context;
      const auto status = predictions_->PredictActionProbabilities(&context, request, &response);
      EXPECT_TRUE(status.ok()) << status.error_message();
      answers += response.SerializeAsString();
    }
    {
      v1::StreamPredictRequest request;
      *request.mutable_request() = request_;
      v1::StreamPredictResponse response;
      grpc::ClientContext context;
      const auto stream = predictions_->StreamPredict(&context);
      EXPECT_TRUE(stream->Write(request));
      EXPECT_TRUE(stream->WritesDone());
      EXPECT_TRUE(stream->Read(&response));
      EXPECT_FALSE(response.has_error()) << response.error().message();
      EXPECT_FALSE(stream->Read(&response));
      EXPECT_TRUE(stream->Finish().ok());
      answers += response.response().SerializeAsString();
    }
    EXPECT_EQ(predicted.predictions_size(), 2);
    EXPECT_EQ(predicted.model_version(), "models/tiny/versions/1");
    return answers;
  }
  static constexpr int kWaysOfAsking = 3;

  double Targets(const std::string& outcome) const {
    return ValueOf(MetricsPage(*server_),
                   "maneuver_shadow_targets_total{outcome=\"" + outcome + "\"}");
  }
  std::filesystem::path models() const { return folder_.path() / "data" / "models" / "tiny"; }

  TemporaryFolder folder_;
  v1::PredictRequest request_;
  int targets_ = 0;
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<v1::PredictionService::Stub> predictions_;
};

TEST_F(ShadowTest, MetricsMeasureTheCandidateWithoutChangingAnswers) {
  const std::string before = Ask();
  EXPECT_EQ(Targets("compared"), 0);  // there is no candidate
  Promote("tiny/2", "candidate");
  EXPECT_EQ(Ask(), before);
  const double asked = kWaysOfAsking * targets_;
  ASSERT_TRUE(WaitFor([&] { return Targets("compared") == asked; }, kPatience))
      << Targets("compared") << " of " << asked;
  EXPECT_EQ(Targets("dropped"), 0);
  EXPECT_EQ(Targets("failed"), 0);

  const std::string page = MetricsPage(*server_);
  for (const std::string measure :
       {"expected_trajectory_distance_meters", "likeliest_trajectory_distance_meters",
        "energy_distance_meters", "divergence_nats"}) {
    const std::string name = "maneuver_shadow_" + measure;
    EXPECT_EQ(ValueOf(page, name + "_count{model=\"tiny\"}"), asked) << measure;
    EXPECT_GT(ValueOf(page, name + "_sum{model=\"tiny\"}"), 0.0) << measure;
  }
  ExpectShape(ShapeOf(page, "maneuver_shadow_"), GOLDEN_SHADOW_METRICS, ACTUAL_SHADOW_METRICS);
  if (HasPromtool()) ExpectPromtoolIsContent(page, folder_.path() / "page");
  EXPECT_EQ(server_->Terminate(), 0);
}

TEST_F(ShadowTest, ACandidateThatCannotBeLoadedFailsNoCall) {
  const std::string before = Ask();
  Promote("tiny/2", "candidate");
  ASSERT_EQ(server_->Terminate(), 0);
  std::ofstream(models() / "2" / "weights.safetensors", std::ios::app) << "damage";
  Start();
  // Versions are loaded one after the other, beside the serving path.
  ASSERT_TRUE(WaitFor(
      [&] { return ValueOf(MetricsPage(*server_), "maneuver_models_loaded") >= 1.0; }, kPatience));
  EXPECT_EQ(Ask(), before);
  ASSERT_TRUE(WaitFor([&] { return Targets("failed") == kWaysOfAsking * targets_; }, kPatience));
  EXPECT_EQ(Targets("compared"), 0);
}

}  // namespace
}  // namespace maneuver::integration::shadow_test
