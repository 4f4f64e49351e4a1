#include "server/serving/version_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "model/artifact/model_folder.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/server/serving/serving_table_fixture.h"

namespace maneuver::serving::version_store_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;

class VersionStoreTest : public ServingTableTest {};

v1::EvaluationReport ReportOn(const std::string& dataset, int64_t examples, int64_t seconds) {
  v1::EvaluationReport report;
  report.set_model_version("models/town/versions/1");
  report.set_dataset("datasets/" + dataset);
  report.set_examples(examples);
  report.mutable_create_time()->set_seconds(seconds);
  (*report.mutable_metrics())["nll"] = 1.25;
  report.add_strata()->set_name("left");
  report.add_sampled_examples()->set_target_id(7);
  return report;
}

TEST_F(VersionStoreTest, KeepsAReportBesideItsVersionOverARestart) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  Restart();
  const auto report = store_->GetReport({{"town", 1}, "unseen"});
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->name(), "models/town/versions/1/evaluations/unseen");
  EXPECT_EQ(report->examples(), 10);
  EXPECT_EQ(report->metrics().at("nll"), 1.25);
  EXPECT_EQ(report->strata_size(), 1);
  EXPECT_EQ(report->sampled_examples_size(), 0);  // the job has those
  // The model knows nothing of it.
  EXPECT_EQ(Answers(Version("town", 1)), 1);
}

TEST_F(VersionStoreTest, LinksThatLeadNowhereDoNotKeepItFromOpening) {
  ASSERT_TRUE(Publish("town").ok());
  for (const std::string link : {"a-model", "zoo", "town/7"}) {
    fs::create_directory_symlink("gone", folder_ / "models" / link);
  }
  Restart();
  EXPECT_TRUE(store_->Contains({"town", 1}));
  EXPECT_FALSE(store_->Contains({"town", 7}));
}

TEST_F(VersionStoreTest, KeepsTheNewestReportOfAVersionOnADataset) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("other", 20, 2)).ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 30, 3)).ok());
  const auto reports = store_->ListReports({"town", 1});
  ASSERT_TRUE(reports.ok()) << reports.status();
  ASSERT_EQ(reports->size(), 2u);
  EXPECT_EQ((*reports)[0].dataset(), "datasets/unseen");
  EXPECT_EQ((*reports)[0].examples(), 30);
  EXPECT_EQ((*reports)[0].strata_size(), 0);
  EXPECT_EQ((*reports)[0].metrics().at("nll"), 1.25);
  EXPECT_EQ((*reports)[1].dataset(), "datasets/other");
}

TEST_F(VersionStoreTest, DeletesReportsWithTheirVersion) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(table_->DeleteAlias({"town", "serving"}).ok());
  ASSERT_TRUE(table_->Delete({"town", 1}).ok());
  EXPECT_TRUE(absl::IsNotFound(store_->GetReport({{"town", 1}, "unseen"}).status()));
  EXPECT_TRUE(absl::IsNotFound(store_->ListReports({"town", 1}).status()));
  EXPECT_TRUE(absl::IsNotFound(store_->KeepReport(ReportOn("unseen", 10, 1))));
  EXPECT_FALSE(fs::exists(folder_ / "models" / "town" / "1"));
}

TEST_F(VersionStoreTest, AMissingReportIsNotFoundAndADamagedOneDoesNotHideOthers) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("other", 10, 1)).ok());
  EXPECT_TRUE(absl::IsNotFound(store_->GetReport({{"town", 1}, "third"}).status()));
  std::ofstream(folder_ / "models" / "town" / "1" / "evaluations" / "unseen.json") << "{\"exam";
  EXPECT_TRUE(absl::IsFailedPrecondition(store_->GetReport({{"town", 1}, "unseen"}).status()));
  const auto reports = store_->ListReports({"town", 1});
  ASSERT_TRUE(reports.ok());
  ASSERT_EQ(reports->size(), 1u);
  EXPECT_EQ((*reports)[0].dataset(), "datasets/other");
}

TEST_F(VersionStoreTest, ARestartRemovesAHalfWrittenReport) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(store_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  const fs::path half =
      folder_ / "models" / "town" / "1" / "evaluations" / ".unseen.json.tmp-0123456789abcdef";
  std::ofstream(half) << "{";
  Restart();
  EXPECT_FALSE(fs::exists(half));
  EXPECT_EQ(store_->ListReports({"town", 1})->size(), 1u);
}

TEST_F(VersionStoreTest, ALabelStaysWithItsVersion) {
  artifact::StoredModel model = artifact::TinyModel();
  for (int k = 0; k < model.manifest.spec().actions(); ++k) {
    model.manifest.add_actions()->set_action_id(k);
  }
  const fs::path finished = folder_ / "finished";
  ASSERT_TRUE(artifact::WriteModelFolder(finished, model).ok());
  ASSERT_TRUE(table_->Publish("town", finished, v1::PROMOTION_UNSPECIFIED).ok());
  const auto before = store_->List("town").at(0).create_time;

  const auto labelled = store_->LabelAction({"town", 1}, 2, "turn left");
  ASSERT_TRUE(labelled.ok()) << labelled.status();
  EXPECT_EQ(labelled->label(), "turn left");
  Restart();
  const auto described = store_->Describe({"town", 1});
  ASSERT_TRUE(described.ok()) << described.status();
  EXPECT_EQ(described->manifest().actions(2).label(), "turn left");
  EXPECT_GT(described->cost().backbone_multiply_adds(), 0);
  EXPECT_EQ(store_->List("town").at(0).create_time, before);
  EXPECT_TRUE(absl::IsOutOfRange(store_->LabelAction({"town", 1}, 3, "x").status()));

  // No two actions have the same name.
  const absl::Status twice = store_->LabelAction({"town", 1}, 0, "turn left").status();
  EXPECT_EQ(twice.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(twice.message()), testing::HasSubstr("action 2"));
  EXPECT_TRUE(store_->LabelAction({"town", 1}, 2, "turn left").ok());
  ASSERT_TRUE(store_->LabelAction({"town", 1}, 2, "").ok());
  EXPECT_TRUE(store_->LabelAction({"town", 1}, 0, "turn left").ok());
}

TEST_F(VersionStoreTest, NeverGivesTheNumberOfADeletedVersionAgain) {
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(table_->Delete({"town", 3}).ok());
  Restart();
  ASSERT_TRUE(table_->Delete({"town", 2}).ok());
  Restart();
  EXPECT_EQ(Publish("town")->version, 4);
}

TEST_F(VersionStoreTest, ListsVersionsNewestFirst) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(Publish("city").ok());
  ASSERT_TRUE(Publish("town", v1::PROMOTION_ALWAYS).ok());
  std::vector<std::string> names;
  for (const auto& version : store_->List("")) names.push_back(version.name.ToString());
  EXPECT_THAT(names, ElementsAre("models/town/versions/2", "models/city/versions/1",
                                 "models/town/versions/1"));
}

TEST_F(VersionStoreTest, PublishesNothingThatItsCheckRefuses) {
  const fs::path finished = FinishedModel();
  security::ModelVersionName checked;
  const auto refused =
      store_->Publish("town", finished, {}, [&](const security::ModelVersionName& name) {
        checked = name;
        return absl::DataLossError("damaged");
      });
  EXPECT_TRUE(absl::IsDataLoss(refused.status()));
  EXPECT_EQ(checked, (security::ModelVersionName{"town", 1}));
  EXPECT_TRUE(fs::exists(finished / "weights.safetensors"));
  EXPECT_FALSE(store_->ContainsModel("town"));
  EXPECT_FALSE(fs::exists(folder_ / "models" / "town"));
}

TEST_F(VersionStoreTest, WithdrawsAPublishedVersionWhole) {
  const fs::path finished = FinishedModel();
  const auto published =
      store_->Publish("town", finished, {"jobs/a"}, [](const auto&) { return absl::OkStatus(); });
  ASSERT_TRUE(published.ok()) << published.status();
  EXPECT_FALSE(fs::exists(finished));
  ASSERT_TRUE(store_->TakeBack(*published, finished).ok());
  EXPECT_TRUE(fs::exists(finished / "weights.safetensors"));
  EXPECT_FALSE(store_->Contains(*published));
  EXPECT_EQ(Publish("town")->version, 1);
}

}  // namespace
}  // namespace maneuver::serving::version_store_test
