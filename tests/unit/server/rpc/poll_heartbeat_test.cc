#include "server/rpc/poll_heartbeat.h"

#include <gtest/gtest.h>

namespace maneuver::rpc {
namespace {

TEST(PollHeartbeatTest, GoesOnUntilItIsDestroyed) {
  PollHeartbeat heartbeat(std::chrono::milliseconds(1));
  heartbeat.AwaitBeats(20);
}

TEST(PollHeartbeatTest, EndsInTheMiddleOfAWait) {
  PollHeartbeat heartbeat(std::chrono::hours(1));
  heartbeat.AwaitBeats(1);
}

}  // namespace
}  // namespace maneuver::rpc
