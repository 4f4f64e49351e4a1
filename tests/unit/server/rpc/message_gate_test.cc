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

  const MessageGate::Time start_{};
  MessageGate gate_{2, 2};
};

TEST_F(MessageGateTest, CallsWaitForAPlaceInTheOrderInWhichTheyCame) {
  const auto first = Enter(milliseconds(0));
  const auto second = Enter(milliseconds(1));
  const auto third = Enter(milliseconds(2));
  const auto fourth = Enter(milliseconds(3));
  EXPECT_THAT(first->told, ElementsAre("receive"));
  EXPECT_THAT(second->told, ElementsAre("receive"));
  EXPECT_THAT(third->told, IsEmpty());
  EXPECT_TRUE(gate_.Leave(*second, start_ + milliseconds(4)));
  EXPECT_THAT(third->told, ElementsAre("receive"));
  EXPECT_THAT(fourth->told, IsEmpty());
  EXPECT_TRUE(gate_.Leave(*first, start_ + milliseconds(5)));
  EXPECT_THAT(fourth->told, ElementsAre("receive"));
}

TEST_F(MessageGateTest, RefusesACallWhenTooManyWait) {
  for (int i = 0; i < 4; ++i) Enter(milliseconds(i));
  EXPECT_THAT(Enter(milliseconds(5))->told, ElementsAre("MEMORY_FULL"));
}

TEST_F(MessageGateTest, RefusesACallThatHasWaitedTooLong) {
  Enter(milliseconds(0));
  Enter(milliseconds(0));
  const auto waiting = Enter(milliseconds(1));
  gate_.Look(start_ + MessageGate::kLongestWait + milliseconds(1));
  EXPECT_THAT(waiting->told, IsEmpty());
  gate_.Look(start_ + MessageGate::kLongestWait + milliseconds(2));
  EXPECT_THAT(waiting->told, ElementsAre("MEMORY_FULL"));
}

TEST_F(MessageGateTest, ASlowRequestGoesOnAsLongAsNobodyWaits) {
  const auto slow = Enter(milliseconds(0));
  Enter(milliseconds(0));
  gate_.Look(start_ + MessageGate::kLongestWait);
  EXPECT_THAT(slow->told, ElementsAre("receive"));
  EXPECT_TRUE(gate_.Leave(*slow, start_ + MessageGate::kLongestWait));
}

TEST_F(MessageGateTest, CancelsOneSlowRequestForEachCallThatWaits) {
  const auto slow = Enter(milliseconds(0));
  const auto other = Enter(milliseconds(0));
  const auto waiting = Enter(milliseconds(100));
  gate_.Look(start_ + MessageGate::kTurn);
  EXPECT_THAT(slow->told, ElementsAre("receive"));
  for (int i = 1; i < 4; ++i) gate_.Look(start_ + MessageGate::kTurn + milliseconds(i));
  EXPECT_THAT(slow->told, ElementsAre("receive", "cancel"));
  EXPECT_THAT(other->told, ElementsAre("receive"));
  // Its memory is not free before it leaves.
  EXPECT_THAT(waiting->told, IsEmpty());
  EXPECT_FALSE(gate_.Leave(*slow, start_ + milliseconds(300)));
  EXPECT_THAT(waiting->told, ElementsAre("receive"));
}

}  // namespace
}  // namespace maneuver::rpc::message_gate_test
