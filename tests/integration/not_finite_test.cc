// Tests that a job fails by name if the metrics of its evaluation are not finite.

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "client/client.h"
#include "maneuver/v1/status.pb.h"
#include "maneuver/v1/training_service.pb.h"
#include "model/artifact/model_folder.h"
#include "tests/integration/trained_server.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/inference/reference_model.h"

namespace maneuver::integration::not_finite_test {
namespace {

// Its weights are finite, but its positions are not.
artifact::StoredModel OverflowingModel() {
  artifact::StoredModel model = inference::RandomModel(artifact::TinySpec(), 1);
  for (auto& [name, tensor] : model.weights) {
    if (!name.starts_with("decoder.") || name == "decoder.covariance") continue;
    for (float& value : tensor.values) value *= 1e30f;
  }
  return model;
}

TEST(NotFiniteTest, AnEvaluationFailsByNameIfAMetricIsNotFinite) {
  const TemporaryFolder temporary;
  const std::filesystem::path& folder = temporary.path();
  const std::filesystem::path data = folder / "data";
  std::filesystem::create_directories(data / "models" / "huge");
  ASSERT_TRUE(artifact::WriteModelFolder(data / "models" / "huge" / "1", OverflowingModel()).ok());
  ASSERT_NO_FATAL_FAILURE(WriteTown(folder / "town", 1, 2, nullptr));
  const ServerProcess server(data);
  std::string output;
  ASSERT_EQ(RunManeuver(server, {"dataset", "upload", (folder / "town").string(), "town"}, &output),
            0)
      << output;

  const auto client = client::Client::Connect({.address = server.address()});
  ASSERT_TRUE(client.ok()) << client.status();
  v1::EvaluateRequest request;
  request.set_model("models/huge/versions/1");
  request.set_dataset("datasets/town");
  const auto begun = (*client)->Evaluate(request);
  ASSERT_TRUE(begun.ok()) << begun.status();
  v1::WatchJobRequest watch;
  watch.set_name(begun->name());
  const auto job = (*client)->WatchJob(watch, [](const v1::Job&) { return true; });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_FAILED) << job->DebugString();
  ASSERT_GT(job->error().details_size(), 0) << job->DebugString();
  v1::ErrorInfo info;
  ASSERT_TRUE(info.ParseFromString(job->error().details(0).value()));
  EXPECT_EQ(info.reason(), "METRICS_NOT_FINITE") << job->error().message();
  EXPECT_FALSE(job->has_evaluation());
}

}  // namespace
}  // namespace maneuver::integration::not_finite_test
