#include "model/machine/thread_priority.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <future>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

namespace maneuver::machine::thread_priority_test {
namespace {

using ::testing::ElementsAre;

pid_t ThisThread() { return static_cast<pid_t>(syscall(SYS_gettid)); }

// A thread that joins groups when told to, and waits until it is ended.
class Member {
 public:
  explicit Member(std::vector<PassingThreads*> groups) {
    std::promise<void> joined;
    thread_ = std::thread([&joined, this, groups = std::move(groups)] {
      for (PassingThreads* group : groups) group->Join();
      id_ = ThisThread();
      joined.set_value();
      end_.get_future().wait();
    });
    joined.get_future().wait();
  }
  ~Member() {
    end_.set_value();
    thread_.join();
  }

  int policy() const { return sched_getscheduler(id_); }

 private:
  std::promise<void> end_;
  pid_t id_ = 0;
  std::thread thread_;
};

TEST(ThreadPriorityTest, AddsNicenessToTheCallingThreadOnly) {
  const int before = getpriority(PRIO_PROCESS, 0);
  std::vector<int> inside;
  std::thread([&inside] {
    for (const int more : {3, 2, 19}) {
      AddNiceness(more);
      inside.push_back(getpriority(PRIO_PROCESS, static_cast<id_t>(ThisThread())));
    }
  }).join();
  EXPECT_THAT(inside, ElementsAre(std::min(before + 3, 19), std::min(before + 5, 19), 19));
  EXPECT_EQ(getpriority(PRIO_PROCESS, 0), before);
}

TEST(PassingThreadsTest, MembersArePatientUntilToldOtherwise) {
  PassingThreads threads;
  const Member first({&threads});
  const Member second({&threads});
  const Member stranger({});
  threads.SetPatient(true);
  EXPECT_EQ(first.policy(), SCHED_BATCH);
  EXPECT_EQ(second.policy(), SCHED_BATCH);
  EXPECT_EQ(stranger.policy(), SCHED_OTHER);
  EXPECT_EQ(sched_getscheduler(ThisThread()), SCHED_OTHER);
  threads.SetPatient(false);
  EXPECT_EQ(first.policy(), SCHED_OTHER);
  EXPECT_EQ(second.policy(), SCHED_OTHER);
}

TEST(PassingThreadsTest, ALateMemberIsPatientAtOnce) {
  PassingThreads threads;
  threads.SetPatient(true);
  const Member late({&threads});
  EXPECT_EQ(late.policy(), SCHED_BATCH);
}

TEST(PassingThreadsTest, JoiningTwiceCountsOnce) {
  PassingThreads threads;
  const Member member({&threads, &threads});
  threads.SetPatient(true);
  EXPECT_EQ(member.policy(), SCHED_BATCH);
  EXPECT_EQ(threads.size(), 1U);
}

TEST(PassingThreadsTest, AThreadLeavesWhenItEnds) {
  PassingThreads threads;
  { const Member member({&threads}); }
  EXPECT_EQ(threads.size(), 0U);
}

TEST(PassingThreadsTest, DestroyingAGroupMakesItsThreadsImpatient) {
  auto threads = std::make_unique<PassingThreads>();
  const Member member({threads.get()});
  threads->SetPatient(true);
  threads.reset();
  EXPECT_EQ(member.policy(), SCHED_OTHER);
}

}  // namespace
}  // namespace maneuver::machine::thread_priority_test
