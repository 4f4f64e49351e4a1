// Reports of evaluations beside the versions of a registry.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/unit/server/serving/model_registry_fixture.h"

namespace maneuver::serving {
namespace {

namespace fs = std::filesystem;

class VersionReportsTest : public ModelRegistryTest {};

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

TEST_F(VersionReportsTest, AReportIsKeptBesideItsVersionOverARestart) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  Restart();
  const auto report = registry_->GetReport({{"town", 1}, "unseen"});
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->name(), "models/town/versions/1/evaluations/unseen");
  EXPECT_EQ(report->examples(), 10);
  EXPECT_EQ(report->metrics().at("nll"), 1.25);
  EXPECT_EQ(report->strata_size(), 1);
  EXPECT_EQ(report->sampled_examples_size(), 0);  // the job has those
  // The model knows nothing of it.
  EXPECT_EQ(Answers(Version("town", 1)), 1);
}

TEST_F(VersionReportsTest, OfAVersionOnADatasetTheNewestReportCounts) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("other", 20, 2)).ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 30, 3)).ok());
  const auto reports = registry_->ListReports({"town", 1});
  ASSERT_TRUE(reports.ok()) << reports.status();
  ASSERT_EQ(reports->size(), 2u);
  EXPECT_EQ((*reports)[0].dataset(), "datasets/unseen");
  EXPECT_EQ((*reports)[0].examples(), 30);
  EXPECT_EQ((*reports)[0].strata_size(), 0);
  EXPECT_EQ((*reports)[0].metrics().at("nll"), 1.25);
  EXPECT_EQ((*reports)[1].dataset(), "datasets/other");
}

TEST_F(VersionReportsTest, ReportsGoWithTheirVersion) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(registry_->DeleteAlias({"town", "serving"}).ok());
  ASSERT_TRUE(registry_->Delete({"town", 1}).ok());
  EXPECT_TRUE(absl::IsNotFound(registry_->GetReport({{"town", 1}, "unseen"}).status()));
  EXPECT_TRUE(absl::IsNotFound(registry_->ListReports({"town", 1}).status()));
  EXPECT_TRUE(absl::IsNotFound(registry_->KeepReport(ReportOn("unseen", 10, 1))));
  EXPECT_FALSE(fs::exists(folder_ / "models" / "town" / "1"));
}

TEST_F(VersionReportsTest, AMissingReportSaysSoAndADamagedOneDoesNotHideTheOthers) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("other", 10, 1)).ok());
  EXPECT_TRUE(absl::IsNotFound(registry_->GetReport({{"town", 1}, "third"}).status()));
  std::ofstream(folder_ / "models" / "town" / "1" / "evaluations" / "unseen.json") << "{\"exam";
  EXPECT_TRUE(absl::IsFailedPrecondition(registry_->GetReport({{"town", 1}, "unseen"}).status()));
  const auto reports = registry_->ListReports({"town", 1});
  ASSERT_TRUE(reports.ok());
  ASSERT_EQ(reports->size(), 1u);
  EXPECT_EQ((*reports)[0].dataset(), "datasets/other");
}

TEST_F(VersionReportsTest, ARestartRemovesAReportThatWasHalfWritten) {
  ASSERT_TRUE(Publish("town").ok());
  ASSERT_TRUE(registry_->KeepReport(ReportOn("unseen", 10, 1)).ok());
  const fs::path half =
      folder_ / "models" / "town" / "1" / "evaluations" / ".unseen.json.tmp-0123456789abcdef";
  std::ofstream(half) << "{";
  Restart();
  EXPECT_FALSE(fs::exists(half));
  EXPECT_EQ(registry_->ListReports({"town", 1})->size(), 1u);
}

}  // namespace
}  // namespace maneuver::serving
