#include "server/serving/target_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/server/serving/fake_action_model.h"

namespace maneuver::serving::target_queue_test {
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

  CallPtr Call(const ModelHandle& model, size_t targets, Priority priority = Priority::kInteractive,
               int64_t bytes = 0) {
    auto call = std::make_shared<PredictionCall>();
    call->model = model;
    call->targets.resize(targets);
    call->priority = priority;
    call->bytes = bytes;
    return call;
  }
  CallPtr Bulk(size_t targets) { return Call(model_, targets, Priority::kBulk); }

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

TEST_F(TargetQueueTest, FillsABatchFromSeveralCalls) {
  TargetQueue queue({.max_batch = 4});
  const std::vector<CallPtr> calls = {Call(model_, 1), Call(model_, 2), Call(model_, 3)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls),
              ElementsAre(Pair(0, 0), Pair(1, 0), Pair(1, 1), Pair(2, 0)));
  EXPECT_EQ(queue.size(), 2);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(2, 1), Pair(2, 2)));
  EXPECT_TRUE(queue.empty());
}

TEST_F(TargetQueueTest, ABatchHasOnlyOneModelVersion) {
  TargetQueue queue({.max_batch = 4});
  const std::vector<CallPtr> calls = {Call(model_, 1), Call(other_model_, 1), Call(model_, 1)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0), Pair(2, 0)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0)));
}

TEST_F(TargetQueueTest, ALargeCallDoesNotMakeASmallOneWaitForAllOfIt) {
  TargetQueue queue({.max_batch = 2});
  const std::vector<CallPtr> calls = {Call(model_, 6), Call(model_, 1)};
  queue.Push(calls[0], kStart);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0), Pair(0, 1)));
  queue.Push(calls[1], kStart);
  EXPECT_EQ(queue.SizeBefore(Priority::kInteractive, 1), 1);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0), Pair(0, 2)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 3), Pair(0, 4)));
}

// By halves all would be done late; one by one all but the last are done earlier, and it no later.
TEST_F(TargetQueueTest, ServesCallsOfOneSizeInOrder) {
  TargetQueue queue({.max_batch = 2});
  const std::vector<CallPtr> calls = {Call(model_, 4), Call(model_, 4)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0), Pair(0, 1)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 2), Pair(0, 3)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0), Pair(1, 1)));
}

TEST_F(TargetQueueTest, SmallCallsDoNotStarveALargeOne) {
  TargetQueue queue({.max_batch = 1});
  const CallPtr large = Call(model_, 10);
  queue.Push(large, kStart);
  int batches = 0;
  while (large->next < 10) {
    ASSERT_LE(++batches, 10 + 10 * TargetQueue::kOvertaking);
    queue.Push(Call(model_, 1), kStart);  // as fast as they are answered
    queue.TakeBatch();
  }
}

TEST_F(TargetQueueTest, APartialBatchWaitsForTheDelayOfItsFirstCall) {
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

TEST_F(TargetQueueTest, LimitsTheNumberOfTargets) {
  TargetQueue queue({.max_batch = 2, .max_queue = 5});
  queue.Push(Call(model_, 4), kStart);
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 1)));
  EXPECT_FALSE(queue.HasRoom(*Call(model_, 2)));
  queue.TakeBatch();
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 3)));
}

TEST_F(TargetQueueTest, CountsACallsBytesUntilItsLastTargetIsTaken) {
  TargetQueue queue({.max_batch = 2, .max_queue_bytes = 1000});
  constexpr auto kInteractive = Priority::kInteractive;
  queue.Push(Call(model_, 3, kInteractive, 600), kStart);
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 1, kInteractive, 400)));
  EXPECT_FALSE(queue.HasRoom(*Call(model_, 1, kInteractive, 401)));
  queue.TakeBatch();
  EXPECT_EQ(queue.bytes(kInteractive), 600);
  queue.TakeBatch();
  EXPECT_EQ(queue.bytes(kInteractive), 0);
  // What died gives its bytes back as well.
  const CallPtr dying = Call(model_, 3, kInteractive, 600);
  queue.Push(dying, kStart);
  dying->cancelled = true;
  queue.TakeDead(kStart);
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 1, kInteractive, 1000)));
}

TEST_F(TargetQueueTest, EachPriorityHasItsOwnRoom) {
  TargetQueue queue({.max_queue = 3, .max_queue_bytes = 1000});
  queue.Push(Call(model_, 3, Priority::kBulk, 1000), kStart);
  EXPECT_FALSE(queue.HasRoom(*Bulk(1)));
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 3, Priority::kInteractive, 1000)));
  queue.Push(Call(model_, 3, Priority::kInteractive, 1000), kStart);
  queue.TakeBatch();
  queue.TakeBatch();
  queue.Push(Call(model_, 3, Priority::kInteractive, 1000), kStart);
  EXPECT_TRUE(queue.HasRoom(*Call(model_, 3, Priority::kBulk, 1000)));
}

TEST_F(TargetQueueTest, InteractiveTargetsPrecedeBulkOnesInSeparateBatches) {
  TargetQueue queue({.max_batch = 4});
  const std::vector<CallPtr> calls = {Bulk(5), Call(model_, 1), Bulk(1), Call(model_, 2)};
  for (const CallPtr& call : calls) queue.Push(call, kStart);

  EXPECT_EQ(queue.SizeBefore(Priority::kInteractive, 2), 3);
  EXPECT_EQ(queue.SizeBefore(Priority::kInteractive, 1), 1);
  EXPECT_EQ(queue.SizeBefore(Priority::kBulk, 5), 9);
  EXPECT_EQ(queue.SizeBefore(Priority::kBulk, 1), 4);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0), Pair(3, 0), Pair(3, 1)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls),
              ElementsAre(Pair(2, 0), Pair(0, 0), Pair(0, 1), Pair(0, 2)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 3), Pair(0, 4)));
}

// The numbers are those of the policy, whatever the sizes of calls and batches.
TEST_F(TargetQueueTest, BulkGetsItsShareUnderInteractiveLoad) {
  for (const double share : {0.1, 0.25}) {
    for (const size_t bulk_call : {1u, 50u}) {
      for (const size_t interactive_call : {1u, 8u}) {
        TargetQueue queue({.max_batch = 8, .bulk_share = share});
        double taken[2] = {0.0, 0.0};
        int since_bulk = 0;
        int longest_wait = 0;
        for (int batch = 0; batch < 1000; ++batch) {
          while (queue.size(Priority::kInteractive) < 16) {
            queue.Push(Call(model_, interactive_call), kStart);
          }
          while (queue.size(Priority::kBulk) < 16) queue.Push(Bulk(bulk_call), kStart);
          const auto items = queue.TakeBatch();
          ASSERT_EQ(items.size(), 8u);
          const Priority priority = items.front().call->priority;
          taken[static_cast<size_t>(priority)] += static_cast<double>(items.size());
          since_bulk = priority == Priority::kBulk ? 0 : since_bulk + 1;
          longest_wait = std::max(longest_wait, since_bulk);
        }
        EXPECT_NEAR(taken[1] / (taken[0] + taken[1]), share, 0.002);
        EXPECT_LE(longest_wait, static_cast<int>((1.0 - share) / share) + 1);
      }
    }
  }
}

TEST_F(TargetQueueTest, AFewBulkTargetsGetTheirTurnInAPartialBatch) {
  TargetQueue queue({.max_batch = 8, .bulk_share = 0.1});
  const CallPtr lonely = Bulk(1);
  queue.Push(lonely, kStart);
  int batches = 0;
  do {
    ASSERT_LT(++batches, 4);  // 1 target is owed after 9 interactive ones
    queue.Push(Call(model_, 8), kStart);
  } while (queue.TakeBatch().front().call != lonely);
}

TEST_F(TargetQueueTest, AReadyBulkBatchAlsoReleasesGatheringInteractiveTargets) {
  TargetQueue queue({.max_batch = 2, .max_queue_delay = milliseconds(5)});
  const std::vector<CallPtr> calls = {Call(model_, 1), Bulk(2)};
  queue.Push(calls[0], kStart);
  EXPECT_EQ(queue.NextBatchTime(), kStart + milliseconds(5));
  queue.Push(calls[1], kStart);
  EXPECT_LT(queue.NextBatchTime(), kStart);
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(0, 0)));
  EXPECT_THAT(Names(queue.TakeBatch(), calls), ElementsAre(Pair(1, 0), Pair(1, 1)));
}

TEST_F(TargetQueueTest, RemovesExpiredAndCancelledCallsFromAnyPlace) {
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

TEST_F(TargetQueueTest, RemovesOnlyTargetsThatNoWorkerTook) {
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
}  // namespace maneuver::serving::target_queue_test
