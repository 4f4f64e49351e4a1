#include "server/rpc/open_calls.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maneuver::rpc::open_calls_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Looks until calls that have begun by now are almost old.
void LookUntilAlmostOld(OpenCalls& calls) {
  for (int64_t look = 1; look < OpenCalls::kOld; ++look)
    EXPECT_THAT(calls.FindCrowded(0), IsEmpty());
}

TEST(OpenCallsTest, NamesPeersWithTooManyOldCalls) {
  OpenCalls calls;
  for (int call = 0; call < 2; ++call) calls.Begin("some");
  for (int call = 0; call < 3; ++call) calls.Begin("many");
  LookUntilAlmostOld(calls);
  EXPECT_THAT(calls.FindCrowded(2), ElementsAre("many"));
  EXPECT_THAT(calls.FindCrowded(1), ElementsAre("many", "some"));
  calls.End("many", 0);
  EXPECT_THAT(calls.FindCrowded(2), IsEmpty());
}

TEST(OpenCallsTest, DoesNotCountYoungCalls) {
  OpenCalls calls;
  calls.Begin("peer");
  LookUntilAlmostOld(calls);
  for (int call = 0; call < 100; ++call) calls.Begin("peer");
  EXPECT_THAT(calls.FindCrowded(1), IsEmpty());
}

TEST(OpenCallsTest, DoesNotCountCallsThatHaveEnded) {
  OpenCalls calls;
  for (int turn = 0; turn < 20; ++turn) {
    const int64_t begun = calls.Begin("one after the other");
    EXPECT_THAT(calls.FindCrowded(0), IsEmpty());
    calls.End("one after the other", begun);
  }
}

}  // namespace
}  // namespace maneuver::rpc::open_calls_test
