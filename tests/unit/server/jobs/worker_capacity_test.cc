#include "server/jobs/worker_capacity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maneuver::jobs::worker_capacity_test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr int64_t kGibibyte = int64_t{1} << 30;

TEST(WorkerCapacityTest, AJobNeedsItsDeviceItsRanksAndTheMemoryOfAllRanks) {
  v1::Job job;
  job.mutable_train()->mutable_settings()->set_device("cuda");
  job.mutable_train()->set_ranks(4);
  job.mutable_memory()->set_total_bytes(3 * kGibibyte);
  const JobNeeds needs = NeedsOf(job);
  EXPECT_EQ(needs.device, "cuda");
  EXPECT_EQ(needs.ranks, 4);
  EXPECT_EQ(needs.memory_bytes, 12 * kGibibyte);

  v1::Job folds;
  folds.mutable_cross_validate()->mutable_settings()->set_device("cuda");
  EXPECT_EQ(NeedsOf(folds).device, "cuda");
  v1::Job evaluation;
  evaluation.mutable_evaluate();
  EXPECT_EQ(NeedsOf(evaluation).device, "cpu");
  EXPECT_EQ(NeedsOf(evaluation).ranks, 1);
}

TEST(WorkerCapacityTest, SaysWhatNoServerHas) {
  const WorkerCapacity small = {{"cpu"}, 2, 8 * kGibibyte};
  const WorkerCapacity large = {{"cpu", "cuda"}, 1, 64 * kGibibyte};
  EXPECT_THAT(WhyNobodyRuns({}, {}), HasSubstr("--role work"));
  EXPECT_EQ(WhyNobodyRuns({}, {small}), "");
  EXPECT_EQ(WhyNobodyRuns({"cuda", 1, 20 * kGibibyte}, {small, large}), "");
  EXPECT_THAT(WhyNobodyRuns({"cuda", 1, 0}, {small}), AllOf(HasSubstr("cuda"), HasSubstr("cpu")));
  EXPECT_THAT(WhyNobodyRuns({"cpu", 4, 100 * kGibibyte}, {small, large}),
              AllOf(HasSubstr("needs 4 ranks"), HasSubstr("at most 2"), HasSubstr("100.0 GiB"),
                    HasSubstr("64.0 GiB")));
  EXPECT_THAT(WhyNobodyRuns({"cpu", 2, 20 * kGibibyte}, {small, large}), HasSubstr("together"));
}

}  // namespace
}  // namespace maneuver::jobs::worker_capacity_test
