// Data folders and models of earlier releases load, and answer as they did.

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"
#include "model/artifact/model_spec.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_index.h"
#include "model/files/durable_file.h"
#include "model/inference/action_model.h"
#include "model/kernels/kernel_choice.h"
#include "server/rpc/prediction_answers.h"
#include "server/rpc/prediction_plan.h"
#include "server/rpc/prediction_query.h"
#include "server/store/sqlite_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::compatibility::data_folder_test {
namespace {

namespace fs = std::filesystem;
using google::protobuf::util::DefaultFieldComparator;
using google::protobuf::util::MessageDifferencer;

template <typename Message>
Message Read(const fs::path& file) {
  Message message;
  EXPECT_TRUE(message.ParseFromString(files::ReadFile(file).value_or("?"))) << file;
  return message;
}

// Processors with other vectors add in another order.
void ExpectNear(const google::protobuf::Message& expected,
                const google::protobuf::Message& actual) {
  DefaultFieldComparator comparator;
  comparator.set_float_comparison(DefaultFieldComparator::APPROXIMATE);
  comparator.SetDefaultFractionAndMargin(1e-5, 1e-5);
  MessageDifferencer differencer;
  differencer.set_field_comparator(&comparator);
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(expected, actual)) << difference;
}

std::shared_ptr<const inference::ActionModel> Load(const fs::path& folder) {
  const auto model =
      inference::ActionModel::Load(folder, {.precision = inference::Precision::kF32});
  EXPECT_TRUE(model.ok()) << model.status();
  return model.value_or(nullptr);
}

// Returns p(y|s) and features of each target of a plan.
std::vector<serving::TargetAnswer> Encode(const inference::ActionModel& model,
                                          const rpc::PredictionPlan& plan) {
  const auto session = model.NewSession();
  scene::SceneReader reader(model.spec());
  std::vector<serving::TargetAnswer> answers(plan.targets.size());
  for (size_t i = 0; i < plan.targets.size(); ++i) {
    scene::SceneInputs inputs = reader.NewInputs();
    serving::ReadScene(plan.targets[i], reader, &inputs);
    const inference::SceneInputsView input = inference::ViewOf(inputs);
    session->Encode({&input, 1}, {&answers[i].encoding, 1});
  }
  return answers;
}

// Answers as the server does, whatever the model is called.
v1::PredictResponse Predict(const inference::ActionModel& model, const v1::PredictRequest& request,
                            const std::string& model_version) {
  const v1::ModelSpec& spec = model.spec();
  const auto plan = rpc::PlanPrediction(request.scenarios(), spec, {}, false);
  EXPECT_GE(plan.targets.size(), 2u);
  const auto question = rpc::ParseQuery(request.query(), spec.actions());
  EXPECT_TRUE(question.ok()) << question.status();
  const auto times = artifact::WaypointTimes(spec.trajectory());
  const auto session = model.NewSession();
  std::vector<serving::TargetAnswer> answers = Encode(model, plan);
  for (serving::TargetAnswer& answer : answers) {
    serving::DescribeTarget(*question, answer.encoding, times.front(), *session, &answer);
  }
  v1::PredictResponse response;
  response.set_model_version(model_version);
  rpc::WritePredictions(request.scenarios(), plan, answers,
                        {.sigma_trajectories = !request.query().omit_sigma_trajectories()},
                        response.mutable_predictions());
  response.mutable_waypoint_times()->Assign(times.begin(), times.end());
  return response;
}

class DataFolderTest : public testing::TestWithParam<const char*> {
 protected:
  DataFolderTest() {
    fs::copy(fs::path(EARLIER_DATA) / GetParam(), folder_.path(),
             fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  }

  const TemporaryFolder folder_;
};

TEST_P(DataFolderTest, TheModelAnswersAsItDid) {
  const auto expected = Read<v1::PredictResponse>(folder_ / "response.bin");
  const auto model = Load(folder_ / "models/town/1");
  ASSERT_NE(model, nullptr);
  ExpectNear(expected, Predict(*model, Read<v1::PredictRequest>(folder_ / "request.bin"),
                               expected.model_version()));
}

TEST_P(DataFolderTest, TheDatasetIsWholeAndItsIndexIsUsed) {
  const fs::path dataset = folder_ / "datasets/seed";
  EXPECT_TRUE(data::VerifyDatasetFolder(dataset).ok()) << data::VerifyDatasetFolder(dataset);
  const auto manifest = data::ReadDatasetManifest(dataset);
  ASSERT_TRUE(manifest.ok()) << manifest.status();
  EXPECT_EQ(manifest->origin(), "a fixture");
  std::vector<std::string> rebuilt;
  const auto index = data::RecordingIndex::Open(
      dataset, [&](const std::string& what) { rebuilt.push_back(what); });
  ASSERT_TRUE(index.ok()) << index.status();
  EXPECT_THAT(rebuilt, testing::IsEmpty());
  ASSERT_EQ(index->entries().size(), 1u);
  EXPECT_EQ(index->Read(0)->scenario_id(), "SEED_1");
}

TEST_P(DataFolderTest, JobsAndAliasesAreThereAndStayThere) {
  for (int start = 0; start < 2; ++start) {
    const auto store = store::SqliteStore::Open(folder_ / "maneuver.db");
    ASSERT_TRUE(store.ok()) << store.status();
    const auto page = (*store)->List(10, "");
    ASSERT_TRUE(page.ok()) << page.status();
    ASSERT_EQ(page->jobs.size(), 1u);
    EXPECT_EQ(page->jobs[0].state(), v1::JOB_STATE_FAILED);
    EXPECT_EQ(page->jobs[0].train().model(), "models/other");
    const auto version = (*store)->GetAlias({"town", "serving"});
    ASSERT_TRUE(version.ok()) << version.status();
    EXPECT_EQ(*version, 1);
    ASSERT_TRUE((*store)->SetAlias({"town", "serving"}, 1).ok());
  }
}

INSTANTIATE_TEST_SUITE_P(Releases, DataFolderTest, testing::Values("2026-11"),
                         [](const auto& release) {
                           return "Of" + std::string(release.param).replace(4, 1, "_");
                         });

// Trained models that an earlier build wrote, and what its server answered by them in f32: by the
// plain kernels, and by those of each target of this processor.
class ModelFolderTest : public testing::TestWithParam<std::tuple<const char*, std::string>> {
 protected:
  ModelFolderTest() {
    kernels::ForceKernelTargetForTest(std::get<1>(GetParam()));
    model_ = Load(folder_);
  }
  ~ModelFolderTest() override { kernels::ForceKernelTargetForTest(kernels::KernelTargets().at(1)); }

  const fs::path folder_ = fs::path(EARLIER_DATA) / "models" / std::get<0>(GetParam());
  std::shared_ptr<const inference::ActionModel> model_;
};

TEST_P(ModelFolderTest, PredictsAsItDid) {
  ASSERT_NE(model_, nullptr);
  auto request = Read<v1::PredictRequest>(folder_ / "request.bin");
  for (const auto& [file, source] : {std::pair("posterior.bin", v1::LATENT_SOURCE_POSTERIOR),
                                     {"prior.bin", v1::LATENT_SOURCE_PRIOR}}) {
    SCOPED_TRACE(file);
    request.mutable_query()->set_source(source);
    const auto expected = Read<v1::PredictResponse>(folder_ / file);
    ExpectNear(expected, Predict(*model_, request, expected.model_version()));
  }
}

TEST_P(ModelFolderTest, ClassifiesAsItDid) {
  ASSERT_NE(model_, nullptr);
  const auto request = Read<v1::PredictRequest>(folder_ / "request.bin");
  const auto plan = rpc::PlanPrediction(request.scenarios(), model_->spec(), {}, true);
  const auto session = model_->NewSession();
  std::vector<serving::TargetAnswer> answers = Encode(*model_, plan);
  for (size_t i = 0; i < answers.size(); ++i) {
    answers[i].classification = session->Classify(answers[i].encoding, plan.targets[i].trajectory);
  }
  const auto expected = Read<v1::ClassifyTrajectoriesResponse>(folder_ / "classified.bin");
  v1::ClassifyTrajectoriesResponse response;
  response.set_model_version(expected.model_version());
  rpc::WriteClassifications(request.scenarios(), plan, answers, response.mutable_classifications());
  ExpectNear(expected, response);
}

INSTANTIATE_TEST_SUITE_P(Releases, ModelFolderTest,
                         testing::Combine(testing::Values("2026-11-raster", "2026-11-lanes",
                                                          "2026-11-lanes-agents"),
                                          testing::ValuesIn(kernels::KernelTargets())),
                         [](const auto& each) {
                           std::string name = std::string("Of_") + std::get<0>(each.param) + "_" +
                                              std::get<1>(each.param);
                           std::ranges::replace(name, '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace maneuver::compatibility::data_folder_test
