#include "server/rpc/poll_heartbeat.h"

#include <gtest/gtest.h>

namespace maneuver::rpc::poll_heartbeat_test {
namespace {

TEST(PollHeartbeatTest, BeatsUntilItIsDestroyed) {
  PollHeartbeat heartbeat(std::chrono::milliseconds(1));
  heartbeat.AwaitBeats(20);
}

TEST(PollHeartbeatTest, EndsDuringAWait) {
  PollHeartbeat heartbeat(std::chrono::hours(1));
  heartbeat.AwaitBeats(1);
}

// gRPC's threads end with the last channel. Were a beat to hold the channel for longer than the
// heartbeat does, one of them would wait for itself.
TEST(PollHeartbeatTest, NoBeatOutlivesTheHeartbeat) {
  for (int i = 0; i < 3000; ++i) {
    PollHeartbeat heartbeat(std::chrono::hours(1));
    heartbeat.AwaitBeats(1);
  }
}

}  // namespace
}  // namespace maneuver::rpc::poll_heartbeat_test
