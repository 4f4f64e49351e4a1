#include "server/rpc/small_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <map>
#include <string>
#include <thread>
#include <vector>

namespace maneuver::rpc::small_messages_test {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

class SmallMessagesTest : public testing::Test {
 protected:
  int64_t Add(const std::string& peer) {
    return messages_.Add(peer, [this, peer] { cancelled_.push_back(peer); });
  }
  void CancelExcess() {
    messages_.CancelExcess([this](const std::string& peer) { return received_[peer]; });
  }

  std::map<std::string, int64_t> received_;
  std::vector<std::string> cancelled_;
  SmallMessages messages_;
};

TEST_F(SmallMessagesTest, LeavesMessagesThatAreAwaitedOnQuietConnections) {
  const int64_t number = Add("a");
  received_["a"] = int64_t{1} << 40;  // before
  for (int i = 0; i < 1000; ++i) {
    CancelExcess();
    received_["a"] += SmallMessages::kMostBytesUnderway / 1000;
  }
  EXPECT_THAT(cancelled_, IsEmpty());
  EXPECT_TRUE(messages_.Remove(number));
}

TEST_F(SmallMessagesTest, CancelsTheMessagesOfTheConnectionsThatBringTheMost) {
  const int64_t small = Add("small");
  const int64_t first = Add("large");
  const int64_t second = Add("large");
  CancelExcess();
  received_["small"] = SmallMessages::kMostBytesUnderway;
  CancelExcess();
  EXPECT_THAT(cancelled_, IsEmpty());
  received_["large"] = SmallMessages::kMostBytesUnderway + 1;
  CancelExcess();
  EXPECT_THAT(cancelled_, ElementsAre("large", "large"));
  CancelExcess();
  EXPECT_THAT(cancelled_, ElementsAre("large", "large")) << "once";
  EXPECT_TRUE(messages_.Remove(small));
  EXPECT_FALSE(messages_.Remove(first));
  EXPECT_FALSE(messages_.Remove(second));
}

TEST_F(SmallMessagesTest, ManyConnectionsHaveNoMoreThanOne) {
  constexpr int kConnections = 100;
  for (int i = 0; i < kConnections; ++i) Add(std::to_string(i));
  CancelExcess();
  for (int i = 0; i < kConnections; ++i) {
    received_[std::to_string(i)] = SmallMessages::kMostBytesUnderway / 50;
  }
  CancelExcess();
  EXPECT_EQ(cancelled_.size(), 50u);
}

TEST_F(SmallMessagesTest, CountsAConnectionAnewOnceNoMessageIsUnderway) {
  ASSERT_TRUE(messages_.Remove(Add("a")));
  const int64_t before = Add("a");
  CancelExcess();
  received_["a"] = SmallMessages::kMostBytesUnderway;
  ASSERT_TRUE(messages_.Remove(before));
  CancelExcess();
  Add("a");
  CancelExcess();
  received_["a"] += SmallMessages::kMostBytesUnderway;
  CancelExcess();
  EXPECT_THAT(cancelled_, IsEmpty());
}

// Such a message was counted before its end, and no look follows that sees its end.
TEST_F(SmallMessagesTest, AMessageThatEndsDuringALookLeavesNothingOfItsConnection) {
  std::atomic<int64_t> number = 0;
  std::atomic<int64_t> received = 0;
  std::atomic<int> looks = 0;
  std::atomic<int> cancelled = 0;
  SmallMessages messages;
  messages.Watch([&](const std::string&) {
    while (number == 0) std::this_thread::yield();
    if (++looks == 1) {
      EXPECT_TRUE(messages.Remove(number));
    }
    return received.load();
  });
  const auto add = [&] { return messages.Add("a", [&cancelled] { ++cancelled; }); };
  const auto wait_for_looks = [&looks](int all) {
    while (looks < all) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  number = add();
  wait_for_looks(1);
  // Long enough for another look, if one came.
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  received = SmallMessages::kMostBytesUnderway + 1;
  const int64_t next = add();
  wait_for_looks(3);
  EXPECT_TRUE(messages.Remove(next));
  EXPECT_EQ(cancelled, 0);
}

}  // namespace
}  // namespace maneuver::rpc::small_messages_test
