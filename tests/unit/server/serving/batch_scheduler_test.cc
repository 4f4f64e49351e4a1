#include "server/serving/batch_scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <future>
#include <limits>
#include <numeric>

#include "maneuver/v1/scenario.pb.h"
#include "model/files/digest.h"
#include "server/errors/error_details.h"
#include "server/monitoring/prometheus_metrics.h"
#include "tests/unit/server/serving/fake_action_model.h"

namespace maneuver::serving::batch_scheduler_test {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

// A clock that stands until it is moved.
class ManualClock {
 public:
  TimePoint Now() const { return TimePoint(std::chrono::nanoseconds(nanoseconds_.load())); }
  void Advance(std::chrono::nanoseconds time) { nanoseconds_ += time.count(); }

 private:
  std::atomic<int64_t> nanoseconds_ = 1'000'000'000;
};

// One target alone on a plain, `length` metres long.
v1::Scenario SceneWith(double length) {
  v1::Scenario scenario;
  v1::Agent* agent = scenario.add_agents();
  agent->set_id(7);
  agent->set_length(length);
  agent->set_width(2.0);
  agent->add_states();
  scenario.add_target_ids(7);
  return scenario;
}

class BatchSchedulerTest : public ::testing::Test {
 protected:
  using Answers = std::vector<TargetAnswer>;

  struct Asked {
    CallPtr call;
    std::future<Answers> answers;
    absl::Status status;
  };

  std::unique_ptr<BatchScheduler> Scheduler(int workers, const QueueOptions& queue) {
    return std::make_unique<BatchScheduler>(
        SchedulerOptions{
            .workers = workers, .queue = queue, .now = [this] { return clock_.Now(); }},
        *metrics_);
  }

  // A line of the metrics page: its name and labels, then its value.
  std::string Metric(const std::string& name) const {
    const std::string page = "\n" + metrics_->Page();
    const size_t start = page.find("\n" + name + " ");
    if (start == std::string::npos) return "none";
    const size_t value = start + name.size() + 2;
    return page.substr(value, page.find('\n', value) - value);
  }
  // "0 1 0 0" after nothing, queue, raster, encode.
  std::string Dropped(const std::string& cause) const {
    std::string counts;
    for (const char* after : {"nothing", "queue", "raster", "encode"}) {
      counts += Metric(std::string("maneuver_dropped_targets_total{after=\"") + after +
                       "\",cause=\"" + cause + "\"}");
      counts += " ";
    }
    return counts;
  }

  Asked Prepare(const v1::Scenario& scenario, size_t targets = 1) {
    Asked asked;
    asked.call = std::make_shared<PredictionCall>();
    asked.call->model = model_;
    asked.call->question = DescribeActions{TopK{1}};
    for (size_t i = 0; i < targets; ++i) {
      asked.call->targets.push_back({&scenario, 7, scene::Pose2(), {}});
    }
    auto promise = std::make_shared<std::promise<Answers>>();
    asked.answers = promise->get_future();
    asked.call->done = [promise](Answers answers) { promise->set_value(std::move(answers)); };
    return asked;
  }

  Asked Ask(BatchScheduler& scheduler, const v1::Scenario& scenario, size_t targets = 1,
            TimePoint deadline = TimePoint::max()) {
    Asked asked = Prepare(scenario, targets);
    asked.call->deadline = deadline;
    asked.status = scheduler.Submit(asked.call);
    return asked;
  }

  // Occupies the only worker inside Encode until the gate opens.
  Asked Occupy(BatchScheduler& scheduler) {
    const size_t before = networks_.batches().size();
    networks_.CloseGate();
    Asked asked = Ask(scheduler, scene_);
    networks_.AwaitBatches(before + 1);
    return asked;
  }

  // Has the only worker find out by a first one, and waits until it is idle again.
  void TargetsTake(std::chrono::nanoseconds time, BatchScheduler& scheduler) {
    Asked first = Occupy(scheduler);
    clock_.Advance(time);
    networks_.OpenGate();
    first.answers.get();
    const auto no_time = [this] { return clock_.Now() + milliseconds(1); };
    while (!scheduler.CheckWait(Priority::kInteractive, 1, no_time()).ok()) {
      std::this_thread::yield();
    }
  }

  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  ManualClock clock_;
  FakeNetworks networks_;
  const ModelHandle model_ = std::make_shared<ServedModel>(
      security::ModelVersionName{"town", 1}, std::make_shared<FakeActionModel>(networks_));
  const v1::Scenario scene_ = SceneWith(4.0);
};

TEST_F(BatchSchedulerTest, TargetsOfSeveralCallsShareABatch) {
  const auto scheduler = Scheduler(1, {.max_batch = 8});
  Asked first = Occupy(*scheduler);
  Asked second = Ask(*scheduler, scene_);
  Asked third = Ask(*scheduler, scene_, 3);
  networks_.OpenGate();
  EXPECT_THAT(third.answers.get(), SizeIs(3));
  EXPECT_THAT(second.answers.get(), SizeIs(1));
  EXPECT_THAT(networks_.batches(), ElementsAre(1, 4));
}

TEST_F(BatchSchedulerTest, ACallLargerThanABatchIsAnsweredWhole) {
  const auto scheduler = Scheduler(1, {.max_batch = 2});
  Asked asked = Ask(*scheduler, scene_, 5);
  const Answers answers = asked.answers.get();
  ASSERT_THAT(answers, SizeIs(5));
  for (const TargetAnswer& answer : answers) {
    EXPECT_TRUE(answer.status.ok());
    EXPECT_THAT(answer.distributions, SizeIs(1));
    EXPECT_EQ(answer.distributions[0].action, 1);
  }
}

TEST_F(BatchSchedulerTest, AnswersForAModelThatReadsVectorsInsteadOfARaster) {
  v1::Scenario moving = SceneWith(4.0);
  moving.mutable_agents(0)->mutable_states(0)->set_velocity_x(6.0F);
  const auto scheduler = Scheduler(1, {.max_batch = 8});
  Asked asked = Prepare(moving, 2);
  asked.call->targets[1].scenario = &scene_;
  asked.call->model = std::make_shared<ServedModel>(security::ModelVersionName{"town", 2},
                                                    FakeActionModel::OfVectors(networks_));
  ASSERT_TRUE(asked.call->model->WarmUp().ok());
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  const Answers answers = asked.answers.get();
  ASSERT_THAT(answers, SizeIs(2));
  EXPECT_EQ(answers[0].encoding.features[0], 6.0F);
  EXPECT_EQ(answers[0].encoding.speed, 6.0);
  EXPECT_EQ(answers[1].encoding.features[0], 0.0F);
  EXPECT_EQ(Metric("maneuver_stage_duration_seconds_count{stage=\"vectors\"}"), "1");
  EXPECT_EQ(Metric("maneuver_stage_duration_seconds_count{stage=\"raster\"}"), "0");
}

TEST_F(BatchSchedulerTest, AFullQueueRefusesWithARetryDelay) {
  const auto scheduler = Scheduler(1, {.max_batch = 8, .max_queue = 3});
  Asked working = Occupy(*scheduler);
  Asked waiting = Ask(*scheduler, scene_, 2);
  EXPECT_TRUE(waiting.status.ok());
  const Asked refused = Ask(*scheduler, scene_, 2);
  EXPECT_TRUE(absl::IsResourceExhausted(refused.status));
  EXPECT_GT(errors::RetryDelay(refused.status).value(), milliseconds(0));
  Asked fits = Ask(*scheduler, scene_, 1);
  EXPECT_TRUE(fits.status.ok());
  networks_.OpenGate();
  EXPECT_THAT(fits.answers.get(), SizeIs(1));
  EXPECT_THAT(waiting.answers.get(), SizeIs(2));
}

TEST_F(BatchSchedulerTest, TheRetryDelayIsTheTimeThatTheWorkersNeedForTheQueue) {
  const auto scheduler = Scheduler(1, {.max_batch = 8, .max_queue = 4});
  Asked first = Occupy(*scheduler);
  clock_.Advance(milliseconds(100));  // for one target
  networks_.OpenGate();
  first.answers.get();
  Asked working = Occupy(*scheduler);
  Asked waiting = Ask(*scheduler, scene_, 4);
  EXPECT_EQ(errors::RetryDelay(Ask(*scheduler, scene_).status), milliseconds(400));
  // The batch at work takes longer than the last one.
  clock_.Advance(milliseconds(150));
  EXPECT_EQ(errors::RetryDelay(Ask(*scheduler, scene_).status), milliseconds(600));
  networks_.OpenGate();
  waiting.answers.get();
}

TEST_F(BatchSchedulerTest, RefusesACallWhoseDeadlineWouldPassInTheQueue) {
  const auto scheduler = Scheduler(1, {.max_batch = 8});
  TargetsTake(milliseconds(100), *scheduler);
  const auto check = [&](int left) {
    return scheduler->CheckWait(Priority::kInteractive, 1, clock_.Now() + milliseconds(left));
  };
  const auto refused = [&] {
    return std::stoi(Metric("maneuver_targets_total{outcome=\"refused\"}"));
  };
  EXPECT_TRUE(check(1).ok());  // the worker is idle: even the shortest deadline is tried
  const int refused_before = refused();
  Asked working = Occupy(*scheduler);
  // Nothing waits, but the worker has 100 ms to go, and the call takes as long.
  // With a quarter more to be sure, and 3 ms for the way: 253.
  EXPECT_FALSE(check(252).ok());
  EXPECT_TRUE(check(253).ok());
  std::vector<Asked> waiting;
  for (int i = 0; i < 4; ++i) waiting.push_back(Ask(*scheduler, scene_));
  // The one at work, four and itself, 100 ms each, and likewise: 753 ms.
  const Asked hopeless = Ask(*scheduler, scene_, 1, clock_.Now() + milliseconds(725));
  EXPECT_EQ(hopeless.status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(errors::ReasonOf(hopeless.status), "DEADLINE_TOO_CLOSE");
  EXPECT_EQ(errors::RetryDelay(hopeless.status), milliseconds(28));
  EXPECT_EQ(check(725), hopeless.status);
  EXPECT_EQ(refused() - refused_before, 3);
  // Two targets take longer than one.
  EXPECT_FALSE(Ask(*scheduler, scene_, 2, clock_.Now() + milliseconds(765)).status.ok());
  Asked patient = Ask(*scheduler, scene_, 1, clock_.Now() + milliseconds(765));
  EXPECT_TRUE(patient.status.ok());
  Asked endless = Ask(*scheduler, scene_);
  EXPECT_TRUE(endless.status.ok());
  networks_.OpenGate();
  EXPECT_TRUE(patient.answers.get()[0].status.ok());
  endless.answers.get();
}

TEST_F(BatchSchedulerTest, AdmitsFewerCallsWhileTheQueueDoesNotEmpty) {
  const auto scheduler = Scheduler(1, {.max_batch = 8});
  TargetsTake(milliseconds(100), *scheduler);
  const auto check = [&](Priority priority, int left) {
    return scheduler->CheckWait(priority, 1, clock_.Now() + milliseconds(left)).ok();
  };
  networks_.CloseGate();
  Asked working = Ask(*scheduler, scene_, 8);
  networks_.AwaitBatches(2);
  Asked waiting = Ask(*scheduler, scene_);
  clock_.Advance(milliseconds(700));
  // The worker has 100 ms to go; the one that waits and the call take as long each: 300 ms. A burst
  // may fill the time that its calls have, but for a quarter: one that lasts no longer than that.
  EXPECT_TRUE(check(Priority::kInteractive, 700));
  // For a call with less time it is none: what goes before it counts three times, itself a quarter
  // more, and 3 ms for the way.
  EXPECT_FALSE(check(Priority::kInteractive, 699));
  clock_.Advance(milliseconds(100));  // the batch at work is done any time
  EXPECT_FALSE(check(Priority::kInteractive, 427));
  EXPECT_TRUE(check(Priority::kInteractive, 428));
  // In the other line nothing stood.
  EXPECT_TRUE(check(Priority::kBulk, 253));
  networks_.OpenGate();
  EXPECT_THAT(working.answers.get(), SizeIs(8));
  EXPECT_TRUE(waiting.answers.get()[0].status.ok());
}

TEST_F(BatchSchedulerTest, SubmittersArePatientWhileThereIsABacklog) {
  const auto scheduler = Scheduler(1, {.max_batch = 1});
  const auto policy = [] { return sched_getscheduler(0); };
  Asked first = Occupy(*scheduler);
  clock_.Advance(milliseconds(4));  // for a target
  Asked second = Ask(*scheduler, scene_);
  Asked third = Ask(*scheduler, scene_);
  EXPECT_EQ(policy(), SCHED_OTHER);  // it was idle when it took the first
  networks_.LetOnePass();
  networks_.AwaitBatches(2);
  EXPECT_EQ(policy(), SCHED_BATCH);
  networks_.LetOnePass();
  networks_.AwaitBatches(3);
  EXPECT_EQ(policy(), SCHED_OTHER);
  networks_.OpenGate();
  third.answers.get();
}

TEST_F(BatchSchedulerTest, RefusesCallsWhileTheQueueIsFullOfBytes) {
  const auto scheduler = Scheduler(1, {.max_queue_bytes = 1000});
  Asked working = Occupy(*scheduler);
  const auto ask = [&](int64_t bytes) {
    Asked asked = Prepare(scene_);
    asked.call->bytes = bytes;
    asked.status = scheduler->Submit(asked.call);
    return asked;
  };
  Asked waiting = ask(900);
  EXPECT_EQ(Metric("maneuver_queue_bytes{priority=\"interactive\"}"), "900");
  EXPECT_EQ(Metric("maneuver_queue_targets{priority=\"interactive\"}"), "1");
  const Asked refused = ask(101);
  EXPECT_EQ(errors::ReasonOf(refused.status), "QUEUE_FULL");
  EXPECT_TRUE(errors::RetryDelay(refused.status).has_value());
  const Asked too_large = ask(1001);
  EXPECT_EQ(errors::ReasonOf(too_large.status), "REQUEST_TOO_LARGE");
  EXPECT_FALSE(errors::RetryDelay(too_large.status).has_value());
  networks_.OpenGate();
  waiting.answers.get();
  EXPECT_TRUE(ask(1000).answers.get().at(0).status.ok());
}

TEST_F(BatchSchedulerTest, InteractiveWorkOvertakesBulkWork) {
  const auto scheduler = Scheduler(1, {.max_batch = 4});
  Asked working = Occupy(*scheduler);
  Asked bulk = Prepare(scene_, 4);
  bulk.call->priority = Priority::kBulk;
  ASSERT_TRUE(scheduler->Submit(bulk.call).ok());
  Asked interactive = Ask(*scheduler, scene_, 2);
  networks_.OpenGate();
  EXPECT_THAT(bulk.answers.get(), SizeIs(4));
  EXPECT_THAT(interactive.answers.get(), SizeIs(2));
  EXPECT_THAT(networks_.batches(), ElementsAre(1, 2, 4));
}

TEST_F(BatchSchedulerTest, RefusesACallThatNeverFitsAndAdvisesToSplitIt) {
  const auto scheduler = Scheduler(1, {.max_queue = 3});
  const Asked refused = Ask(*scheduler, scene_, 4);
  EXPECT_TRUE(absl::IsResourceExhausted(refused.status));
  EXPECT_THAT(std::string(refused.status.message()), HasSubstr("at most 3"));
  EXPECT_FALSE(errors::RetryDelay(refused.status).has_value());
}

TEST_F(BatchSchedulerTest, ExpiredWorkMakesRoomInAFullQueue) {
  const auto scheduler = Scheduler(1, {.max_queue = 2});
  Asked working = Occupy(*scheduler);
  Asked expiring = Ask(*scheduler, scene_, 2, clock_.Now() + milliseconds(10));
  clock_.Advance(milliseconds(10));
  Asked fresh = Ask(*scheduler, scene_, 2);
  EXPECT_TRUE(fresh.status.ok());
  // Answered at once, although the worker is still occupied.
  EXPECT_TRUE(absl::IsDeadlineExceeded(expiring.answers.get().at(0).status));
  networks_.OpenGate();
  EXPECT_TRUE(fresh.answers.get().at(0).status.ok());
}

TEST_F(BatchSchedulerTest, WorkThatExpiresInTheQueueNeverReachesTheNetworks) {
  const auto scheduler = Scheduler(1, {.max_batch = 8});
  Asked working = Occupy(*scheduler);
  Asked expiring = Ask(*scheduler, scene_, 3, clock_.Now() + milliseconds(10));
  Asked patient = Ask(*scheduler, scene_, 1, clock_.Now() + milliseconds(30));
  clock_.Advance(milliseconds(10));
  networks_.OpenGate();
  for (const TargetAnswer& answer : expiring.answers.get()) {
    EXPECT_TRUE(absl::IsDeadlineExceeded(answer.status));
  }
  EXPECT_TRUE(patient.answers.get().at(0).status.ok());
  EXPECT_THAT(networks_.batches(), ElementsAre(1, 1));
}

TEST_F(BatchSchedulerTest, RefusesExpiredAndCancelledCalls) {
  const auto scheduler = Scheduler(1, {});
  EXPECT_TRUE(absl::IsDeadlineExceeded(Ask(*scheduler, scene_, 1, clock_.Now()).status));
  Asked cancelled = Prepare(scene_);
  cancelled.call->cancelled = true;
  EXPECT_TRUE(absl::IsCancelled(scheduler->Submit(cancelled.call)));
  EXPECT_THAT(networks_.batches(), SizeIs(0));
}

TEST_F(BatchSchedulerTest, WorkThatIsCancelledInTheQueueNeverReachesTheNetworks) {
  const auto scheduler = Scheduler(1, {});
  Asked working = Occupy(*scheduler);
  Asked cancelled = Ask(*scheduler, scene_, 2);
  cancelled.call->cancelled = true;
  networks_.OpenGate();
  EXPECT_TRUE(absl::IsCancelled(cancelled.answers.get().at(1).status));
  EXPECT_THAT(networks_.batches(), ElementsAre(1));
}

TEST_F(BatchSchedulerTest, WorkThatIsCancelledWhileItIsEncodedIsNotDescribed) {
  const auto scheduler = Scheduler(1, {});
  Asked working = Occupy(*scheduler);
  working.call->cancelled = true;
  networks_.OpenGate();
  EXPECT_TRUE(absl::IsCancelled(working.answers.get().at(0).status));
  EXPECT_EQ(networks_.described(), 0);
}

TEST_F(BatchSchedulerTest, WorkThatIsCancelledWhileItIsDrawnNeverReachesTheNetworks) {
  Asked asked = Prepare(scene_, 2);
  networks_.on_new_session = [&] { asked.call->cancelled = true; };
  const auto scheduler = Scheduler(1, {});
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  EXPECT_TRUE(absl::IsCancelled(asked.answers.get().at(1).status));
  EXPECT_THAT(networks_.batches(), SizeIs(0));
  EXPECT_EQ(Dropped("cancelled"), "0 0 2 0 ");
}

TEST_F(BatchSchedulerTest, CountsDroppedWorkByStage) {
  const auto scheduler = Scheduler(1, {});
  EXPECT_FALSE(Ask(*scheduler, scene_, 3, clock_.Now()).status.ok());
  EXPECT_EQ(Dropped("expired"), "3 0 0 0 ");

  networks_.CloseGate();
  const TimePoint soon = clock_.Now() + milliseconds(10);
  Asked encoding = Ask(*scheduler, scene_, 1, soon);
  networks_.AwaitBatches(1);
  Asked waiting = Ask(*scheduler, scene_, 2, soon);
  Asked leaving = Ask(*scheduler, scene_, 4);
  leaving.call->cancelled = true;
  clock_.Advance(milliseconds(10));
  networks_.OpenGate();
  encoding.answers.get();
  waiting.answers.get();
  leaving.answers.get();
  EXPECT_EQ(Dropped("expired"), "3 2 0 1 ");
  EXPECT_EQ(Dropped("cancelled"), "0 4 0 0 ");
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"expired\"}"), "6");
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"cancelled\"}"), "4");
}

// Action k stands at (k, k), so the medoid is action 1, between the others.
TEST_F(BatchSchedulerTest, DescribesRepresentativesBesideTheSelection) {
  networks_.probabilities = Eigen::Vector3d(0.4, 0.25, 0.35);
  const auto scheduler = Scheduler(1, {});
  const auto ask = [&](int representatives) {
    Asked asked = Prepare(scene_);
    asked.call->question =
        DescribeActions{TopK{1}, inference::LatentSource::kPosterior, representatives};
    EXPECT_TRUE(scheduler->Submit(asked.call).ok());
    return asked.answers.get().at(0);
  };
  const auto described = [](const TargetAnswer& answer) {
    std::vector<int> actions;
    for (const auto& each : answer.distributions) actions.push_back(each.action);
    return actions;
  };
  const TargetAnswer none = ask(0);
  EXPECT_THAT(none.representatives, SizeIs(0));
  EXPECT_THAT(described(none), ElementsAre(0));
  EXPECT_EQ(networks_.means(), 0);

  const TargetAnswer one = ask(1);
  ASSERT_THAT(one.representatives, SizeIs(1));
  EXPECT_EQ(one.representatives[0].action, 1);
  EXPECT_EQ(one.representatives[0].weight, 1.0);
  EXPECT_THAT(described(one), ElementsAre(0, 1));  // by probability, each once
  EXPECT_EQ(networks_.means(), kFakeActions);

  // Action 0 leaves 0.35 at a distance, action 2 leaves 0.4.
  const TargetAnswer two = ask(2);
  ASSERT_THAT(two.representatives, SizeIs(2));
  EXPECT_EQ(two.representatives[0].action, 1);
  EXPECT_NEAR(two.representatives[0].weight, 0.6, 1e-12);
  EXPECT_EQ(two.representatives[1].action, 0);
  EXPECT_NEAR(two.representatives[1].weight, 0.4, 1e-12);
  EXPECT_THAT(described(two), ElementsAre(0, 1));
}

TEST_F(BatchSchedulerTest, WorkThatIsCancelledWhileItIsEncodedGetsNoRepresentatives) {
  const auto scheduler = Scheduler(1, {});
  networks_.CloseGate();
  Asked asked = Prepare(scene_);
  asked.call->question = DescribeActions{TopK{1}, inference::LatentSource::kPosterior, 2};
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  networks_.AwaitBatches(1);
  asked.call->cancelled = true;
  networks_.OpenGate();
  EXPECT_TRUE(absl::IsCancelled(asked.answers.get().at(0).status));
  EXPECT_EQ(networks_.means(), 0);
}

// Two road users, 2 m wide and long, 2.5 m apart and face to face. Action k stands at (k, k).
v1::Scenario FaceToFace() {
  v1::Scenario scene = SceneWith(2.0);
  v1::Agent* other = scene.add_agents();
  *other = scene.agents(0);
  other->set_id(8);
  other->mutable_states(0)->set_x(2.5);
  other->mutable_states(0)->set_heading(M_PI);
  scene.add_target_ids(8);
  return scene;
}

TEST_F(BatchSchedulerTest, CombinesTheActionsOfEachScenariosTargets) {
  const auto scheduler = Scheduler(2, {.max_batch = 1});
  const v1::Scenario both = FaceToFace();
  const auto ask = [&](int combinations) {
    Asked asked = Prepare(both);
    DescribeActions question{TopK{1}};
    question.combinations = combinations;
    asked.call->question = question;
    asked.call->targets = {{&both, 7, scene::Pose2(), {}},
                           {&both, 8, scene::Pose2(2.5, 0.0, M_PI), {}},
                           {&scene_, 7, scene::Pose2(), {}}};
    EXPECT_TRUE(scheduler->Submit(asked.call).ok());
    auto answers = asked.answers.get();
    return std::pair(std::move(answers), std::move(asked.call->joint));
  };
  EXPECT_THAT(ask(0).second, SizeIs(0));
  for (int repeat = 0; repeat < 20; ++repeat) {
    const auto [answers, joint] = ask(6);
    ASSERT_THAT(joint, SizeIs(2));
    // Whoever leaves its place meets the other.
    EXPECT_THAT(joint[0].targets, ElementsAre(0, 1));
    ASSERT_THAT(joint[0].found.combinations, SizeIs(1));
    EXPECT_THAT(joint[0].found.combinations[0].actions, ElementsAre(0, 0));
    EXPECT_THAT(joint[1].targets, ElementsAre(2));
    EXPECT_THAT(joint[1].found.combinations, SizeIs(3));
    EXPECT_NEAR(joint[1].found.combinations[0].weight, 0.5, 1e-12);
    // The combined action is described beside the most probable one, by probability.
    for (const size_t i : {0, 1}) {
      ASSERT_THAT(answers[i].distributions, SizeIs(2));
      EXPECT_EQ(answers[i].distributions[0].action, 1);
      EXPECT_EQ(answers[i].distributions[1].action, 0);
    }
    EXPECT_THAT(answers[2].distributions, SizeIs(3));
  }
}

TEST_F(BatchSchedulerTest, ACallThatEndsEarlyIsNotCombined) {
  const auto scheduler = Scheduler(1, {.max_batch = 1});
  const v1::Scenario both = FaceToFace();
  networks_.CloseGate();
  Asked asked = Prepare(both, 2);
  DescribeActions question{TopK{1}};
  question.combinations = 6;
  asked.call->question = question;
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  networks_.AwaitBatches(1);
  asked.call->cancelled = true;
  networks_.OpenGate();
  for (const TargetAnswer& answer : asked.answers.get()) {
    EXPECT_TRUE(absl::IsCancelled(answer.status));
  }
  EXPECT_THAT(asked.call->joint, SizeIs(1));
  EXPECT_THAT(asked.call->joint[0].targets, SizeIs(0));
}

TEST_F(BatchSchedulerTest, ClassificationGetsItsTrajectory) {
  const auto scheduler = Scheduler(1, {});
  Asked asked = Prepare(scene_);
  asked.call->question = ClassifyTrajectory();
  asked.call->targets[0].trajectory = inference::Trajectory::Constant(2, 2, 4.5);
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  const Answers answers = asked.answers.get();
  EXPECT_EQ(answers.at(0).classification.value().log_likelihood_bound, 4.5);
  EXPECT_EQ(networks_.described(), 0);
}

TEST_F(BatchSchedulerTest, AnswersWaitingCallsWhenItEnds) {
  auto scheduler = Scheduler(1, {});
  Asked working = Occupy(*scheduler);
  Asked waiting = Ask(*scheduler, scene_);
  // The destructor waits for the worker, which waits for the gate.
  std::thread opener([&] { networks_.OpenGate(); });
  scheduler = nullptr;
  opener.join();
  EXPECT_TRUE(working.answers.get().at(0).status.ok());
  const absl::Status status = waiting.answers.get().at(0).status;
  EXPECT_TRUE(status.ok() || absl::IsUnavailable(status)) << status;
}

TEST_F(BatchSchedulerTest, EachTargetGetsItsOwnAnswerUnderLoadFromManyThreads) {
  constexpr int kScenes = 8;
  constexpr int kCallers = 4;
  constexpr int kCallsOfEach = 50;
  // What each scene's raster sums to, alone.
  std::vector<v1::Scenario> scenes;
  std::vector<double> expected;
  for (int i = 0; i < kScenes; ++i) {
    scenes.push_back(SceneWith(2.0 + i));
    const auto alone = Scheduler(1, {});
    expected.push_back(
        Ask(*alone, scenes.back()).answers.get().at(0).distributions.at(0).latent_mean[0]);
  }
  for (int i = 1; i < kScenes; ++i) ASSERT_NE(expected[i], expected[i - 1]);

  const auto scheduler = Scheduler(3, {.max_batch = 4, .max_queue = 100'000});
  std::atomic<int> answered = 0;
  std::atomic<int> cancelled = 0;
  const auto caller = [&](int seed) {
    for (int n = 0; n < kCallsOfEach; ++n) {
      Asked asked = Prepare(scenes[0]);
      asked.call->targets.clear();
      const int targets = 1 + (seed + n) % 6;
      std::vector<int> order;
      for (int t = 0; t < targets; ++t) {
        order.push_back((seed * 31 + n * 7 + t * 3) % kScenes);
        asked.call->targets.push_back({&scenes[static_cast<size_t>(order.back())], 7, {}, {}});
      }
      asked.call->priority = n % 3 == 0 ? Priority::kBulk : Priority::kInteractive;
      ASSERT_TRUE(scheduler->Submit(asked.call).ok());
      if (n % 5 == 0) asked.call->cancelled = true;
      const Answers answers = asked.answers.get();
      ASSERT_THAT(answers, SizeIs(static_cast<size_t>(targets)));
      for (int t = 0; t < targets; ++t) {
        const TargetAnswer& answer = answers[static_cast<size_t>(t)];
        if (answer.status.ok()) {
          ++answered;
          EXPECT_EQ(answer.distributions.at(0).latent_mean[0],
                    expected[static_cast<size_t>(order[static_cast<size_t>(t)])]);
        } else {
          ++cancelled;
          EXPECT_TRUE(absl::IsCancelled(answer.status));
          EXPECT_EQ(n % 5, 0);
        }
      }
    }
  };
  std::vector<std::thread> callers;
  for (int i = 0; i < kCallers; ++i) callers.emplace_back(caller, i);
  for (std::thread& thread : callers) thread.join();
  EXPECT_GT(answered, 0);
}

TEST_F(BatchSchedulerTest, WithholdsAnAnswerWhoseProbabilitiesAreNotFinite) {
  networks_.probabilities[1] = std::numeric_limits<double>::quiet_NaN();
  const auto scheduler = Scheduler(1, {});
  const Answers answers = Ask(*scheduler, scene_).answers.get();
  EXPECT_EQ(answers[0].status.code(), absl::StatusCode::kInternal);
  EXPECT_EQ(errors::ReasonOf(answers[0].status), "ANSWER_UNSOUND");
  EXPECT_TRUE(answers[0].distributions.empty());
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"unsound\"}"), "1");
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"answered\"}"), "0");
}

TEST_F(BatchSchedulerTest, WithholdsAnAnswerWhoseTrajectoryIsNotFinite) {
  networks_.ahead = std::numeric_limits<double>::infinity();
  const auto scheduler = Scheduler(1, {});
  testing::internal::CaptureStderr();
  const Answers answers = Ask(*scheduler, scene_).answers.get();
  EXPECT_EQ(errors::ReasonOf(answers[0].status), "ANSWER_UNSOUND");
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_THAT(log, HasSubstr("answer withheld"));
  EXPECT_THAT(log, HasSubstr("scenario_sha256=" + files::Sha256Hex(scene_.SerializeAsString())));
}

TEST_F(BatchSchedulerTest, AnEngineThatFailsCostsItsBatchAndIsReplaced) {
  int engines = 0;
  networks_.on_new_session = [&] { ++engines; };
  networks_.failing_batches = {0};
  const auto scheduler = Scheduler(1, {});
  const Answers failed = Ask(*scheduler, scene_, 2).answers.get();
  for (const TargetAnswer& answer : failed) {
    EXPECT_EQ(answer.status.code(), absl::StatusCode::kInternal);
    EXPECT_EQ(errors::ReasonOf(answer.status), "ENGINE_FAILED");
  }
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"unsound\"}"), "2");
  EXPECT_TRUE(Ask(*scheduler, scene_).answers.get()[0].status.ok());
  EXPECT_EQ(engines, 2);
  EXPECT_TRUE(Ask(*scheduler, scene_).answers.get()[0].status.ok());
  EXPECT_EQ(engines, 2);
}

TEST_F(BatchSchedulerTest, AnEngineThatFailsForOneTargetAnswersTheOthers) {
  networks_.failing_descriptions = {1};
  const auto scheduler = Scheduler(1, {});
  const Answers answers = Ask(*scheduler, scene_, 3).answers.get();
  EXPECT_TRUE(answers[0].status.ok());
  EXPECT_EQ(errors::ReasonOf(answers[1].status), "ENGINE_FAILED");
  EXPECT_TRUE(answers[2].status.ok());
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"answered\"}"), "2");
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"unsound\"}"), "1");
}

TEST_F(BatchSchedulerTest, AnEngineThatFailsWhileTargetsAreCombinedFailsThem) {
  // Each target is described, then the actions of the combinations.
  networks_.failing_descriptions = {2};
  const auto scheduler = Scheduler(1, {});
  const v1::Scenario both = FaceToFace();
  Asked asked = Prepare(both);
  DescribeActions question{TopK{1}};
  question.combinations = 6;
  asked.call->question = question;
  asked.call->targets = {{&both, 7, scene::Pose2(), {}},
                         {&both, 8, scene::Pose2(2.5, 0.0, M_PI), {}}};
  ASSERT_TRUE(scheduler->Submit(asked.call).ok());
  for (const TargetAnswer& answer : asked.answers.get()) {
    EXPECT_EQ(errors::ReasonOf(answer.status), "ENGINE_FAILED");
  }
  EXPECT_THAT(asked.call->joint[0].found.combinations, SizeIs(0));
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"answered\"}"), "0");
  EXPECT_EQ(Metric("maneuver_targets_total{outcome=\"unsound\"}"), "2");
}

}  // namespace
}  // namespace maneuver::serving::batch_scheduler_test
