#include "server/jobs/job_state.h"

#include <gtest/gtest.h>

#include <set>
#include <utility>

namespace maneuver::jobs::job_state_test {
namespace {

TEST(JobStateTest, AllowsOnlyTheEightMovesOfTheContract) {
  const std::set<std::pair<int, int>> allowed = {
      {v1::JOB_STATE_PENDING, v1::JOB_STATE_RUNNING},
      {v1::JOB_STATE_PENDING, v1::JOB_STATE_CANCELLED},
      {v1::JOB_STATE_RUNNING, v1::JOB_STATE_SUCCEEDED},
      {v1::JOB_STATE_RUNNING, v1::JOB_STATE_FAILED},
      {v1::JOB_STATE_RUNNING, v1::JOB_STATE_CANCELLED},
      {v1::JOB_STATE_RUNNING, v1::JOB_STATE_PENDING},
      {v1::JOB_STATE_FAILED, v1::JOB_STATE_PENDING},
      {v1::JOB_STATE_CANCELLED, v1::JOB_STATE_PENDING},
  };
  for (int from = v1::JobState_MIN; from <= v1::JobState_MAX; ++from) {
    for (int to = v1::JobState_MIN; to <= v1::JobState_MAX; ++to) {
      EXPECT_EQ(CanMove(static_cast<v1::JobState>(from), static_cast<v1::JobState>(to)),
                allowed.contains({from, to}))
          << from << " to " << to;
    }
  }
}

TEST(JobStateTest, AllStatesButPendingAndRunningHaveEnded) {
  EXPECT_FALSE(HasEnded(v1::JOB_STATE_PENDING));
  EXPECT_FALSE(HasEnded(v1::JOB_STATE_RUNNING));
  EXPECT_TRUE(HasEnded(v1::JOB_STATE_SUCCEEDED));
  EXPECT_TRUE(HasEnded(v1::JOB_STATE_FAILED));
  EXPECT_TRUE(HasEnded(v1::JOB_STATE_CANCELLED));
}

TEST(JobStateTest, OnlyFailedAndCancelledJobsCanBeResumed) {
  for (const v1::JobState state : kJobStates) {
    EXPECT_EQ(CanResume(state), state == v1::JOB_STATE_FAILED || state == v1::JOB_STATE_CANCELLED);
  }
  EXPECT_FALSE(CanResume(v1::JOB_STATE_UNSPECIFIED));
}

TEST(JobStateTest, EveryStateHasALabelOfItsOwn) {
  std::set<std::string_view> labels;
  for (const v1::JobState state : kJobStates) labels.insert(JobStateLabel(state));
  EXPECT_EQ(labels.size(), kJobStates.size());
  EXPECT_FALSE(labels.contains("unknown"));
}

}  // namespace
}  // namespace maneuver::jobs::job_state_test
