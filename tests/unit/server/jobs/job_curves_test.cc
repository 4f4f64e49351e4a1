#include "server/jobs/job_curves.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/monitoring/prometheus_metrics.h"
#include "tests/unit/server/jobs/supervisor_fixture.h"

namespace maneuver::jobs::job_curves_test {
namespace {

using ::testing::HasSubstr;

v1::JobProgress Epoch() {
  v1::JobProgress progress;
  progress.set_fraction(0.5);
  progress.set_examples_per_second(300.0);
  v1::EpochReport& epoch = *progress.mutable_epoch_report();
  (*epoch.mutable_training())["loss"] = 3.5;
  (*epoch.mutable_validation())["loss"] = 4.5;
  (*epoch.mutable_validation())["log_likelihood"] = -1.25;
  epoch.add_action_usage(1.0);
  epoch.set_effective_actions(7);
  return progress;
}

TEST(JobCurvesTest, EachSlotShowsItsJobUntilItEnds) {
  const auto metrics = monitoring::PrometheusMetrics::Create();
  JobCurves curves(*metrics, 2);
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_fraction{slot=\"2\"} Nan\n"));
  curves.Show(1, Epoch());
  for (const char* line :
       {"maneuver_job_fraction{slot=\"1\"} Nan", "maneuver_job_fraction{slot=\"2\"} 0.5",
        "maneuver_training_examples_per_second{slot=\"2\"} 300",
        "maneuver_training_loss_nats{of=\"training\",slot=\"2\"} 3.5",
        "maneuver_training_loss_nats{of=\"validation\",slot=\"2\"} 4.5",
        "maneuver_training_log_likelihood_nats{slot=\"2\"} -1.25",
        "maneuver_training_effective_actions{slot=\"2\"} 7"}) {
    EXPECT_THAT(metrics->Page(), HasSubstr("\n" + std::string(line) + "\n"));
  }
  // A step within the next epoch leaves what the last one came to.
  v1::JobProgress step;
  step.set_fraction(0.6);
  curves.Show(1, step);
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_fraction{slot=\"2\"} 0.6"));
  EXPECT_THAT(metrics->Page(), HasSubstr("_loss_nats{of=\"training\",slot=\"2\"} 3.5\n"));
  // An epoch before there is a mixture has no likelihood.
  v1::JobProgress pretraining;
  (*pretraining.mutable_epoch_report()->mutable_training())["loss"] = 9.5;
  curves.Show(1, pretraining);
  EXPECT_THAT(metrics->Page(), HasSubstr("_loss_nats{of=\"training\",slot=\"2\"} 9.5\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("_log_likelihood_nats{slot=\"2\"} Nan\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("_effective_actions{slot=\"2\"} Nan\n"));
  curves.Clear(1);
  EXPECT_THAT(metrics->Page(), HasSubstr("_loss_nats{of=\"training\",slot=\"2\"} Nan\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_fraction{slot=\"2\"} Nan\n"));
}

using JobMetricsTest = SupervisorTest;

TEST_F(JobMetricsTest, ShowsCurvesOfARunningJobAndCountsEveryEnd) {
  const auto metrics = monitoring::PrometheusMetrics::Create();
  UseMetrics(*metrics);
  Trainer(R"(trap 'exit 143' TERM; echo '{"phase":"joint","fraction":0.25}'
             while :; do sleep 0.02; done)");
  Start();
  const std::string running = Train().name();
  const std::string waiting = Train().name();
  WaitForProgress(running);
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_fraction{slot=\"1\"} 0.25\n"));
  ASSERT_TRUE(supervisor_->Cancel(waiting).ok());
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_ends_total{state=\"cancelled\"} 1\n"));
  ASSERT_TRUE(supervisor_->Cancel(running).ok());
  WaitForEnd(running);
  Trainer("echo 'no' >&2; exit 65");
  WaitForEnd(Train().name());
  supervisor_->Stop();  // what is stored is counted a moment later
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_ends_total{state=\"cancelled\"} 2\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_ends_total{state=\"failed\"} 1\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_ends_total{state=\"succeeded\"} 0\n"));
  EXPECT_THAT(metrics->Page(), HasSubstr("\nmaneuver_job_fraction{slot=\"1\"} Nan\n"));
}

}  // namespace
}  // namespace maneuver::jobs::job_curves_test
