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
    void Cancel() override { told.emplace_back("cancel"); }
    void Refuse(const absl::Status& status) override { told.push_back(errors::ReasonOf(status)); }
    std::vector<std::string> told;
  };

  std::shared_ptr<Call> Enter(milliseconds at) {
    auto call = std::make_shared<Call>();
    gate_.Enter(call, start_ + at);
    return call;
  }
  void Look(milliseconds at, size_t allowed) { gate_.Look(start_ + at, allowed); }

  const MessageGate::Time start_{};
  MessageGate gate_{2};
};

TEST_F(MessageGateTest, LetsAnyNumberOfQuickRequestsPass) {
  for (int i = 0; i < 100; ++i) {
    const auto call = Enter(milliseconds(i));
    EXPECT_THAT(call->told, ElementsAre("receive"));
    Look(milliseconds(i) + MessageGate::kYoung, 0);
    EXPECT_TRUE(gate_.Leave(*call));
  }
}

TEST_F(MessageGateTest, OfTooManySlowRequestsKeepsThoseThatCameFirst) {
  std::vector<std::shared_ptr<Call>> calls;
  calls.reserve(5);
  for (int i = 0; i < 5; ++i) calls.push_back(Enter(milliseconds(0)));
  const auto young = Enter(milliseconds(1));
  for (int i = 0; i < 2; ++i) Look(MessageGate::kYoung + milliseconds(1), 3);
  for (int i = 0; i < 3; ++i) EXPECT_THAT(calls[i]->told, ElementsAre("receive")) << i;
  for (int i = 3; i < 5; ++i) EXPECT_THAT(calls[i]->told, ElementsAre("receive", "cancel")) << i;
  EXPECT_THAT(young->told, ElementsAre("receive"));
  EXPECT_EQ(gate_.CountSlow(start_ + MessageGate::kYoung), 0u);
  EXPECT_EQ(gate_.CountSlow(start_ + MessageGate::kYoung + milliseconds(1)), 5u);
  EXPECT_TRUE(gate_.Leave(*calls[0]));
  EXPECT_FALSE(gate_.Leave(*calls[3]));
}

// Otherwise callers who never send their requests would keep out those who do.
TEST_F(MessageGateTest, CancelsThoseFirstThatHaveTakenLongerThanATurn) {
  const auto lazy = Enter(milliseconds(0));
  const auto first = Enter(milliseconds(100));
  const auto second = Enter(milliseconds(200));
  Look(MessageGate::kTurn + milliseconds(1), 2);
  EXPECT_THAT(lazy->told, ElementsAre("receive", "cancel"));
  EXPECT_THAT(first->told, ElementsAre("receive"));
  EXPECT_THAT(second->told, ElementsAre("receive"));
}

TEST_F(MessageGateTest, SlowRequestsGoOnAsLongAsTheyAreAllowed) {
  const auto slow = Enter(milliseconds(0));
  Look(milliseconds(60'000), 1);
  EXPECT_THAT(slow->told, ElementsAre("receive"));
}

TEST_F(MessageGateTest, NewCallsWaitUntilNoMoreThanAllowedAreSlow) {
  const auto slow = Enter(milliseconds(0));
  Look(milliseconds(21), 0);
  const auto waiting = Enter(milliseconds(22));
  const auto another = Enter(milliseconds(23));
  EXPECT_THAT(Enter(milliseconds(24))->told, ElementsAre("MEMORY_FULL")) << "two may wait";
  // Its memory is not free before it leaves.
  Look(milliseconds(40), 0);
  EXPECT_THAT(waiting->told, IsEmpty());
  EXPECT_FALSE(gate_.Leave(*slow));
  Look(milliseconds(60), 0);
  EXPECT_THAT(waiting->told, ElementsAre("receive"));
  EXPECT_THAT(another->told, ElementsAre("receive"));
}

}  // namespace
}  // namespace maneuver::rpc::message_gate_test
