// Data folders of earlier releases load, and answer as they did.

#include <gmock/gmock.h>
#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"
#include "model/artifact/model_spec.h"
#include "model/data/dataset_folder.h"
#include "model/data/recording_index.h"
#include "model/files/durable_file.h"
#include "model/inference/action_model.h"
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

class DataFolderTest : public testing::TestWithParam<const char*> {
 protected:
  DataFolderTest() {
    fs::copy(fs::path(EARLIER_DATA) / GetParam(), folder_.path(),
             fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  }

  template <typename Message>
  Message Read(const char* file) const {
    Message message;
    EXPECT_TRUE(message.ParseFromString(files::ReadFile(folder_ / file).value_or("?"))) << file;
    return message;
  }

  const TemporaryFolder folder_;
};

TEST_P(DataFolderTest, TheModelAnswersAsItDid) {
  const auto request = Read<v1::PredictRequest>("request.bin");
  const auto expected = Read<v1::PredictResponse>("response.bin");
  const auto model = inference::ActionModel::Load(folder_ / "models/town/1",
                                                  {.precision = inference::Precision::kF32});
  ASSERT_TRUE(model.ok()) << model.status();
  const v1::ModelSpec& spec = (*model)->spec();
  const auto session = (*model)->NewSession();
  scene::SceneReader reader(spec);
  const auto plan = rpc::PlanPrediction(request.scenarios(), spec, {}, false);
  ASSERT_GE(plan.targets.size(), 2u);
  const auto question = rpc::ParseQuery(request.query(), spec.actions());
  ASSERT_TRUE(question.ok()) << question.status();
  std::vector<serving::TargetAnswer> answers(plan.targets.size());
  for (size_t i = 0; i < plan.targets.size(); ++i) {
    scene::SceneInputs inputs = reader.NewInputs();
    serving::ReadScene(plan.targets[i], reader, &inputs);
    const inference::SceneInput input = inference::InputOf(inputs);
    session->Encode({&input, 1}, {&answers[i].encoding, 1});
    serving::DescribeTarget(*question, answers[i].encoding, 0.1, *session, &answers[i]);
  }
  v1::PredictResponse response;
  rpc::WritePredictions(request.scenarios(), plan, answers, {}, response.mutable_predictions());
  response.set_model_version(expected.model_version());
  for (const double time : artifact::WaypointTimes(spec.trajectory())) {
    response.add_waypoint_times(time);
  }

  // Processors with other vectors add in another order.
  DefaultFieldComparator comparator;
  comparator.set_float_comparison(DefaultFieldComparator::APPROXIMATE);
  comparator.SetDefaultFractionAndMargin(1e-5, 1e-5);
  MessageDifferencer differencer;
  differencer.set_field_comparator(&comparator);
  std::string difference;
  differencer.ReportDifferencesToString(&difference);
  EXPECT_TRUE(differencer.Compare(expected, response)) << difference;
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

}  // namespace
}  // namespace maneuver::compatibility::data_folder_test
