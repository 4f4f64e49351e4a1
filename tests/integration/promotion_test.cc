// Tests how versions are evaluated, compared and promoted, with real processes and tiny models.

#include <gmock/gmock.h>
#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "maneuver/v1/model_service.grpc.pb.h"
#include "maneuver/v1/training_service.grpc.pb.h"
#include "tests/integration/trained_server.h"

namespace maneuver::integration::promotion_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

// models/tiny with version 1, which serves.
class PromotionTest : public ::testing::Test {
 protected:
  // Runs the command, expects `status`, and returns what it printed.
  std::string Run(const std::vector<std::string>& command, int status = 0) {
    std::string output;
    EXPECT_EQ(RunManeuver(trained_.server(), command, &output), status) << output;
    return output;
  }
  // Returns the command that trains a model and promotes it if it is no worse.
  std::vector<std::string> Train(const std::string& settings) const {
    return {"train",
            "tiny",
            "--dataset",
            "town",
            "--settings",
            settings,
            "--promote",
            "if-no-worse",
            "--promote-dataset",
            "unseen",
            "--promote-metric",
            "min_ade_6",
            "--promote-metric",
            "nll"};
  }
  std::string Serving() {
    v1::GetModelVersionRequest request;
    request.set_name("models/tiny");
    v1::ModelVersion version;
    grpc::ClientContext context;
    const auto status = v1::ModelService::NewStub(trained_.server().channel())
                            ->GetModelVersion(&context, request, &version);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return version.name();
  }
  v1::Job Job(const std::string& name) {
    v1::GetJobRequest request;
    request.set_name(name);
    v1::Job job;
    grpc::ClientContext context;
    const auto status =
        v1::TrainingService::NewStub(trained_.server().channel())->GetJob(&context, request, &job);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return job;
  }
  // Returns settings with which a model learns almost nothing.
  std::string WorseSettings() const {
    v1::TrainingSettings settings;
    EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(kTinySettings, &settings).ok());
    settings.mutable_optimization()->set_pretraining_epochs(1);
    settings.mutable_optimization()->set_mixture_epochs(1);
    settings.mutable_optimization()->set_joint_epochs(1);
    settings.mutable_optimization()->set_learning_rate(1e-7);
    std::string json;
    EXPECT_TRUE(google::protobuf::util::MessageToJsonString(settings, &json).ok());
    const fs::path file = trained_.folder() / "worse.json";
    std::ofstream(file) << json;
    return file.string();
  }

  TrainedServer trained_;
};

TEST_F(PromotionTest, PromotesAnEqualVersionButNoWorseOneEvenIfTheServerIsKilled) {
  // No version has been evaluated yet, so there is nothing to compare.
  EXPECT_THAT(Run({"model", "compare", "tiny/1", "tiny", "--dataset", "unseen"}, 1),
              HasSubstr("maneuver evaluate tiny/1 --dataset unseen"));

  const std::string worse = Run(Train(WorseSettings()));
  EXPECT_THAT(worse, HasSubstr("tiny/2 was not promoted: worse than models/tiny/versions/1 on "
                               "datasets/unseen"));
  EXPECT_EQ(Serving(), "models/tiny/versions/1");

  // Both versions were evaluated by the job, so their reports can be listed and compared.
  EXPECT_THAT(Run({"model", "show", "tiny/2"}), ContainsRegex("evaluated on +unseen \\("));
  const std::string compared = Run({"model", "compare", "tiny/1", "tiny/2", "--strata"});
  EXPECT_THAT(compared, ContainsRegex("METRIC +UNIT +tiny/1 +tiny/2 +DIFFERENCE +BETTER"));
  EXPECT_THAT(compared, ContainsRegex("min_ade_6 +m +[0-9.]+ +[0-9.]+ +[+-][0-9.]+ +tiny/1"));
  EXPECT_THAT(compared, ContainsRegex("turn: left +[0-9]+ +nll +nats"));
  EXPECT_THAT(compared, Not(HasSubstr("ade_cv")));
  const std::string json = Run({"model", "compare", "tiny/1", "tiny/2", "--output", "json"});
  v1::EvaluationComparison comparison;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(json, &comparison).ok()) << json;
  EXPECT_EQ(comparison.baseline(), "models/tiny/versions/1");
  EXPECT_GT(comparison.metrics_size(), 40);

  // Every evaluation says where the version is ahead; a promotion can require it.
  const std::string measured = Run({"evaluate", "tiny/2", "--dataset", "unseen"});
  EXPECT_THAT(measured, HasSubstr("AHEAD BY ade_1, m?"));
  EXPECT_THAT(measured, ContainsRegex("all +[0-9]+ +BEHIND \\+[0-9.]+"));
  EXPECT_THAT(measured,
              ContainsRegex("ade_1: ahead of constant velocity in [0-9]+ of [0-9]+ strata"));
  const std::string refused =
      Run({"model", "promote", "tiny/2", "--dataset", "unseen", "--not-behind", "cv@strata"}, 1);
  EXPECT_THAT(refused, HasSubstr("behind constant velocity by ade_1 over all examples (+"));
  EXPECT_EQ(Serving(), "models/tiny/versions/1");

  // A version that was evaluated with other settings cannot be compared.
  Run({"evaluate", "tiny/2", "--dataset", "unseen", "--set", "stride=2s"});
  EXPECT_THAT(Run({"model", "compare", "tiny/1", "tiny/2"}, 1), HasSubstr("stride=2s"));

  // The settings of version 2 make an equal version. The server is killed while it is published.
  Run({"model", "promote", "tiny/2"});
  std::vector<std::string> command = Train(WorseSettings());
  command.insert(command.end(), {"--detach", "--output", "json"});
  v1::Job job;
  const std::string started = Run(command);
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(started, &job).ok()) << started;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(240);
  while (!fs::exists(trained_.data_dir() / "models" / "tiny" / "3")) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  trained_.server().Kill();
  trained_.Restart();
  Run({"job", "watch", job.name()});
  job = Job(job.name());
  EXPECT_EQ(job.state(), v1::JOB_STATE_SUCCEEDED) << job.DebugString();
  EXPECT_EQ(job.model_version(), "models/tiny/versions/3");
  EXPECT_TRUE(job.promotion_decision().promoted()) << job.promotion_decision().DebugString();
  for (const auto& metric : job.promotion_decision().comparison().metrics()) {
    EXPECT_EQ(metric.baseline_value(), metric.candidate_value()) << metric.metric();
  }
  EXPECT_EQ(Serving(), "models/tiny/versions/3");
  EXPECT_THAT(Run({"job", "show", job.name()}), HasSubstr("tiny/3 was promoted: no worse than"));
  EXPECT_THAT(Run({"model", "compare", "tiny/2", "tiny"}), ContainsRegex("nll +nats.* 0.000 +="));

  // Reports are deleted with their version.
  Run({"model", "delete", "tiny/1"});
  EXPECT_FALSE(fs::exists(trained_.data_dir() / "models" / "tiny" / "1"));
}

TEST_F(PromotionTest, ContinuesFromAVersionWithMoreWeightOnNewRecordings) {
  const std::vector<std::string> command = {"train",        "tiny",
                                            "--start-from", "tiny",
                                            "--dataset",    "town",
                                            "--dataset",    "unseen=3",
                                            "--epochs",     "1",
                                            "--set",        "optimization.posterior_epochs=1",
                                            "--set",        "examples.max_examples=500",
                                            "--set",        "threads=1"};
  const std::string learned = Run(command);
  EXPECT_THAT(learned, HasSubstr("joint"));
  EXPECT_THAT(learned, Not(HasSubstr("mixture 1/")));
  EXPECT_THAT(Run({"model", "show", "tiny/2"}), ContainsRegex("started from +tiny/1"));
  v1::ModelVersion version;
  const std::string json = Run({"model", "show", "tiny/2", "--output", "json"});
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(json, &version).ok()) << json;
  EXPECT_EQ(version.manifest().spec().actions(), 12);
  const auto& weights = version.manifest().provenance().settings().examples().dataset_weights();
  EXPECT_THAT(weights, ::testing::ElementsAre(1.0, 3.0));

  std::vector<std::string> other_sizes = command;
  other_sizes.insert(other_sizes.end(), {"--actions", "13"});
  EXPECT_THAT(Run(other_sizes, 1), HasSubstr("settings.model"));
  EXPECT_THAT(Run({"train", "tiny", "--dataset", "town=0"}, 2), HasSubstr("city=3"));
}

}  // namespace
}  // namespace maneuver::integration::promotion_test
