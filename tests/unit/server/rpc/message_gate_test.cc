#include "server/rpc/message_gate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "server/errors/error_details.h"

namespace maneuver::rpc::message_gate_test {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::IsEmpty;

class MessageGateTest : public testing::Test {
 protected:
  // Notes what it is told.
  class Call final : public UnreceivedCall {
   public:
    void Receive() override { told.emplace_back("receive"); }
    void Refuse(const absl::Status& status) override { told.push_back(errors::ReasonOf(status)); }
    void Stop(const absl::Status& status) override {
      told.push_back("stop: " + errors::ReasonOf(status));
    }
    void Cancel() override { told.emplace_back("cancel"); }
    std::vector<std::string> told;
  };

  bool Leave(const UnreceivedCall& call) { return gate_.Leave(call); }
  // Calls come by the connection "large" unless they say otherwise.
  std::shared_ptr<Call> Enter(milliseconds at, const std::string& peer = "large") {
    auto call = std::make_shared<Call>();
    gate_.Enter(call, peer, start_ + at);
    return call;
  }
  void StopExcess(milliseconds at, size_t allowed) {
    gate_.Weigh({{"large", int64_t{1} << 40}, {"small", MessageGate::kSmallBytes}});
    gate_.StopExcess(start_ + at, allowed);
  }

  const MessageGate::Time start_{std::chrono::hours(1)};
  MessageGate gate_{2};
};

const char kStopped[] = "stop: MEMORY_FULL";

TEST_F(MessageGateTest, LetsAnyNumberOfQuickRequestsPass) {
  for (int i = 0; i < 100; ++i) {
    const auto call = Enter(milliseconds(i));
    EXPECT_THAT(call->told, ElementsAre("receive"));
    StopExcess(milliseconds(i) + MessageGate::kYoung, 0);
    EXPECT_TRUE(Leave(*call));
  }
}

TEST_F(MessageGateTest, OfTooManyLargeRequestsKeepsThoseThatCameFirst) {
  std::vector<std::shared_ptr<Call>> calls;
  calls.reserve(5);
  for (int i = 0; i < 5; ++i) calls.push_back(Enter(milliseconds(0)));
  const auto young = Enter(milliseconds(1));
  for (int i = 0; i < 2; ++i) StopExcess(MessageGate::kYoung + milliseconds(1), 3);
  for (int i = 0; i < 3; ++i) EXPECT_THAT(calls[i]->told, ElementsAre("receive")) << i;
  for (int i = 3; i < 5; ++i) EXPECT_THAT(calls[i]->told, ElementsAre("receive", kStopped)) << i;
  EXPECT_THAT(young->told, ElementsAre("receive"));
  EXPECT_EQ(gate_.CountLarge(start_ + MessageGate::kYoung), 0u);
  EXPECT_EQ(gate_.CountLarge(start_ + MessageGate::kYoung + milliseconds(1)), 5u);
  EXPECT_TRUE(Leave(*calls[0]));
  EXPECT_FALSE(Leave(*calls[3]));
}

// Beside large senders on a busy machine the requests of a planner take long, too.
TEST_F(MessageGateTest, SlowRequestsOfAConnectionWithSmallOnesPass) {
  std::vector<std::shared_ptr<Call>> small;
  small.reserve(10);
  for (int i = 0; i < 3; ++i) small.push_back(Enter(milliseconds(0), "small"));
  const auto large = Enter(milliseconds(1));
  StopExcess(milliseconds(100), 0);
  EXPECT_THAT(large->told, ElementsAre("receive", kStopped));
  while (small.size() < 10) small.push_back(Enter(milliseconds(101), "small"));
  StopExcess(milliseconds(1000), 0);
  for (const auto& each : small) {
    EXPECT_THAT(each->told, ElementsAre("receive"));
    EXPECT_TRUE(Leave(*each));
  }
}

TEST_F(MessageGateTest, AConnectionHasLargeRequestsIfItBroughtMuchForEachOfItsCalls) {
  const auto count = [this](int calls) {
    MessageGate gate(2);
    std::vector<std::shared_ptr<Call>> entered;
    for (int i = 0; i < calls; ++i) {
      gate.Enter(entered.emplace_back(std::make_shared<Call>()), "some", start_);
    }
    gate.Weigh({{"some", 2 * MessageGate::kSmallBytes}});
    return gate.CountLarge(start_ + milliseconds(100));
  };
  EXPECT_EQ(count(1), 1u);
  EXPECT_EQ(count(2), 0u);
}

TEST_F(MessageGateTest, EachConnectionCountsAsOneWithLargeRequestsUntilItIsWeighed) {
  const auto slow = Enter(milliseconds(0), "small");
  gate_.StopExcess(start_ + milliseconds(21), 0);
  EXPECT_THAT(slow->told, ElementsAre("receive", "stop: MEMORY_FULL"));
  EXPECT_THAT(Enter(milliseconds(22), "new")->told, IsEmpty());
}

TEST_F(MessageGateTest, StopsRequestsOfAnySizeThatTakeTooLong) {
  const auto late = Enter(milliseconds(0), "small");
  const auto other = Enter(milliseconds(1), "small");
  const auto stop = [this](milliseconds at) { gate_.StopLate(start_ + at, milliseconds(500)); };
  stop(milliseconds(500));
  EXPECT_THAT(late->told, ElementsAre("receive"));
  for (int i = 0; i < 2; ++i) stop(milliseconds(501));
  EXPECT_THAT(late->told, ElementsAre("receive", "stop: REQUEST_TOO_SLOW"));
  EXPECT_THAT(other->told, ElementsAre("receive"));
  EXPECT_TRUE(Leave(*other));
  for (int i = 0; i < 2; ++i) stop(milliseconds(502) + MessageGate::kTurn);
  EXPECT_THAT(late->told, ElementsAre("receive", "stop: REQUEST_TOO_SLOW", "cancel"));
  EXPECT_FALSE(Leave(*late));
}

// Otherwise callers who never send their requests would keep out those who do.
TEST_F(MessageGateTest, StopsThoseFirstThatHaveTakenLongerThanATurn) {
  const auto lazy = Enter(milliseconds(0));
  const auto first = Enter(milliseconds(100));
  const auto second = Enter(milliseconds(200));
  StopExcess(MessageGate::kTurn + milliseconds(1), 2);
  EXPECT_THAT(lazy->told, ElementsAre("receive", kStopped));
  EXPECT_THAT(first->told, ElementsAre("receive"));
  EXPECT_THAT(second->told, ElementsAre("receive"));
}

TEST_F(MessageGateTest, CancelsAStoppedCallWhoseCallerDoesNotTakeItsEnd) {
  const auto deaf = Enter(milliseconds(0));
  StopExcess(milliseconds(100), 0);
  StopExcess(milliseconds(100) + MessageGate::kTurn, 0);
  EXPECT_THAT(deaf->told, ElementsAre("receive", kStopped));
  for (int i = 0; i < 2; ++i) StopExcess(milliseconds(101) + MessageGate::kTurn, 0);
  EXPECT_THAT(deaf->told, ElementsAre("receive", kStopped, "cancel"));
}

TEST_F(MessageGateTest, LargeRequestsGoOnAsLongAsTheyAreAllowed) {
  const auto slow = Enter(milliseconds(0));
  StopExcess(milliseconds(60'000), 1);
  EXPECT_THAT(slow->told, ElementsAre("receive"));
}

TEST_F(MessageGateTest, NewCallsWaitUntilNoMoreThanAllowedAreLarge) {
  EXPECT_FALSE(gate_.HasSlow(start_ + milliseconds(21)));
  const auto slow = Enter(milliseconds(0));
  EXPECT_FALSE(gate_.HasSlow(start_ + milliseconds(20)));
  EXPECT_TRUE(gate_.HasSlow(start_ + milliseconds(21)));
  StopExcess(milliseconds(21), 0);
  const auto waiting = Enter(milliseconds(22));
  const auto another = Enter(milliseconds(23));
  EXPECT_THAT(Enter(milliseconds(24))->told, ElementsAre("MEMORY_FULL")) << "two may wait";
  EXPECT_THAT(Enter(milliseconds(25), "small")->told, ElementsAre("receive"));
  // Its memory is not free before it leaves.
  StopExcess(milliseconds(40), 0);
  EXPECT_THAT(waiting->told, IsEmpty());
  EXPECT_FALSE(Leave(*slow));
  EXPECT_TRUE(gate_.HasSlow(start_ + milliseconds(41))) << "those that wait";
  StopExcess(milliseconds(60), 0);
  EXPECT_THAT(waiting->told, ElementsAre("receive"));
  EXPECT_THAT(another->told, ElementsAre("receive"));
}

}  // namespace
}  // namespace maneuver::rpc::message_gate_test
