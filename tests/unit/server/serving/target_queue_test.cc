#include "server/serving/target_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/server/serving/fake_action_model.h"

namespace maneuver::serving {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

constexpr TimePoint kStart{std::chrono::hours(1)};

class TargetQueueTest : public ::testing::Test {
 protected:
  static ModelHandle Model(int version) {
    static FakeNetworks networks;
    return std::make_shared<ServedModel>(security::ModelVersionName{"town", version},
                                         std::make_shared<FakeActionModel>(networks));
  }

  CallPtr Call(const ModelHandle& model, size_t targets) {
    auto call = std::make_shared<PredictionCall>();
    call->model = model;
    call->targets.resize(targets);
    return call;
  }

  // Which targets of which calls, calls by their place in `calls`.
  static std::vector<std::pair<int, size_t>> Names(const std::vector<TargetQueue::Item>& items,
                                                   const std::vector<CallPtr>& calls) {
    std::vector<std::pair<int, size_t>> names;
    for (const auto& item : items) {
      const auto found = std::find(calls.begin(), calls.end(), item.call);
      names.emplace_back(static_cast<int>(found - calls.begin()), item.target);
    }
    return names;
  }

  const ModelHandle model_ = Model(1);
  const ModelHandle other_model_ = Model(2);
};

TEST_F(TargetQueueTest, ABatchIsFilledFromSeveralCalls) {
  TargetQueue queue({.max_batch = 4});
  const std::vector<CallPtr> calls = {Call(model_, 1), Call(model_, 2), Call(model_, 3)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls),
              ElementsAre(Pair(0, 0), Pair(1, 0), Pair(1, 1), Pair(2, 0)));
  EXPECT_EQ(queue.size(), 2);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(2, 1), Pair(2, 2)));
  EXPECT_TRUE(queue.empty());
}

TEST_F(TargetQueueTest, ABatchAsksOneModelVersionOnly) {
  TargetQueue queue({.max_batch = 4});
  const std::vector<CallPtr> calls = {Call(model_, 1), Call(other_model_, 1), Call(model_, 1)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0), Pair(2, 0)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0)));
}

TEST_F(TargetQueueTest, ALargeCallDoesNotMakeASmallOneWaitForAllOfIt) {
  TargetQueue queue({.max_batch = 2});
  const std::vector<CallPtr> calls = {Call(model_, 6), Call(model_, 1)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0), Pair(0, 1)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0), Pair(0, 2)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 3), Pair(0, 4)));
}

TEST_F(TargetQueueTest, ABatchThatIsNotFullWaitsForTheDelayOfItsFirstCall) {
  TargetQueue queue({.max_batch = 3, .max_queue_delay = milliseconds(5)});
  EXPECT_EQ(queue.NextBatchTime(), TimePoint::max());
  queue.Push(Call(model_, 1), kStart);
  queue.Push(Call(model_, 1), kStart + milliseconds(2));
  EXPECT_EQ(queue.NextBatchTime(), kStart + milliseconds(5));
  queue.Push(Call(other_model_, 1), kStart + milliseconds(3));  // fills no batch of model_
  EXPECT_EQ(queue.NextBatchTime(), kStart + milliseconds(5));
  queue.Push(Call(model_, 1), kStart + milliseconds(3));  // does
  EXPECT_LT(queue.NextBatchTime(), kStart);
}

TEST_F(TargetQueueTest, RoomIsCountedInTargets) {
  TargetQueue queue({.max_batch = 2, .max_queue = 5});
  queue.Push(Call(model_, 4), kStart);
  EXPECT_TRUE(queue.HasRoom(1));
  EXPECT_FALSE(queue.HasRoom(2));
  queue.TakeBatch();
  EXPECT_TRUE(queue.HasRoom(3));
}

TEST_F(TargetQueueTest, ExpiredAndCancelledCallsAreTakenOutFromAnyPlace) {
  TargetQueue queue({.max_batch = 8});
  const std::vector<CallPtr> calls = {Call(model_, 1), Call(model_, 2), Call(model_, 1)};
  calls[1]->deadline = kStart + milliseconds(10);
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(queue.TakeDead(kStart + milliseconds(9)), IsEmpty());
  EXPECT_THAT(Names(queue.TakeDead(kStart + milliseconds(10)), calls),
              ElementsAre(Pair(1, 0), Pair(1, 1)));
  calls[2]->cancelled = true;
  EXPECT_THAT(Names(queue.TakeDead(kStart), calls), ElementsAre(Pair(2, 0)));
  EXPECT_EQ(queue.size(), 1);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0)));
}

TEST_F(TargetQueueTest, OnlyTargetsThatNoWorkerTookAreTakenOut) {
  TargetQueue queue({.max_batch = 2});
  const std::vector<CallPtr> calls = {Call(model_, 3)};
  queue.Push(calls[0], kStart);
  queue.TakeBatch();
  EXPECT_THAT(Names(queue.TakeAll(), calls), ElementsAre(Pair(0, 2)));
  EXPECT_EQ(queue.size(), 0);
}

TEST(SelectActionsTest, OrdersByProbabilityThenId) {
  const Eigen::VectorXd p = Eigen::Vector4d(0.04, 0.4, 0.4, 0.16);
  EXPECT_THAT(SelectActions(p, AtLeast{0.05}), ElementsAre(1, 2, 3));
  EXPECT_THAT(SelectActions(p, AtLeast{0.4}), ElementsAre(1, 2));
  EXPECT_THAT(SelectActions(p, AtLeast{0.0}), ElementsAre(1, 2, 3, 0));
  EXPECT_THAT(SelectActions(p, TopK{1}), ElementsAre(1));
  EXPECT_THAT(SelectActions(p, TopK{9}), ElementsAre(1, 2, 3, 0));
  EXPECT_THAT(SelectActions(p, ActionIds{{0, 3}}), ElementsAre(3, 0));
}

}  // namespace
}  // namespace maneuver::serving
