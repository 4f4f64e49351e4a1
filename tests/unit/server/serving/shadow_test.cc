#include "server/serving/shadow.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <fstream>
#include <future>
#include <limits>

#include "maneuver/v1/scenario.pb.h"
#include "model/files/durable_file.h"
#include "server/monitoring/prometheus_metrics.h"
#include "tests/unit/server/serving/fake_action_model.h"
#include "tests/unit/server/serving/memory_alias_store.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::serving::shadow_test {
namespace {

namespace fs = std::filesystem;
using ::testing::IsEmpty;

v1::Scenario Scene() {
  v1::Scenario scenario;
  v1::Agent* agent = scenario.add_agents();
  agent->set_id(7);
  agent->set_length(4.0);
  agent->set_width(2.0);
  agent->add_states();
  scenario.add_target_ids(7);
  return scenario;
}

// A model "town" whose version 1 serves and whose version 2 is the candidate.
class ShadowTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Open();
    for (const char* weights : {"first", "second"}) {
      const fs::path finished = folder_ / "finished";
      fs::create_directories(finished);
      std::ofstream(finished / "weights.safetensors") << weights;
      std::ofstream(finished / "model.json") << "{}";
      ASSERT_TRUE(table_->Publish("town", finished, v1::PROMOTION_UNSPECIFIED).ok());
    }
    ASSERT_TRUE(table_->SetAlias({"town", "candidate"}, 2).ok());
    warm_ups_ = candidate_.batches().size();
  }
  void TearDown() override {
    candidate_.OpenGate();
    shadow_ = nullptr;
    table_ = nullptr;
  }

  void Open() {
    table_ = nullptr;
    auto store = VersionStore::Open(folder_ / "models");
    ASSERT_TRUE(store.ok()) << store.status();
    store_ = *std::move(store);
    auto opened = ServingTable::Open(
        *store_, aliases_,
        [this](const fs::path& folder)
            -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          const auto weights = files::ReadFile(folder / "weights.safetensors");
          if (!weights.ok() || *weights == "altered") return absl::DataLossError("altered");
          return std::make_shared<FakeActionModel>(*weights == "first" ? first_ : candidate_);
        },
        {}, monitoring::MetricRegistry::Null());
    ASSERT_TRUE(opened.ok()) << opened.status();
    table_ = *std::move(opened);
    table_->LoadAliased();
  }

  void Start(ShadowOptions options = {.fraction = 1.0, .max_share = 1.0}) {
    // The shadow's thread may be made to wait with the lock held; no test is about that.
    options.max_tries = std::numeric_limits<int>::max();
    shadow_ = std::make_unique<Shadow>(
        options, *table_,
        [this] {
          ++looks_;
          return busy_.load();
        },
        *metrics_);
  }

  ModelHandle Serving() { return *table_->Find(security::ModelAliasName{"town", "serving"}); }

  // What `first_` has answered for so many targets; ready once the shadow has let go of it.
  std::future<void> Offer(const ModelHandle& answered, size_t targets = 1, int64_t bytes = 0) {
    PredictionCall call;
    call.model = answered;
    call.bytes = bytes;
    call.targets.assign(targets, {&scene_, 7, scene::Pose2(), {}});
    std::vector<TargetAnswer> answers(targets);
    for (TargetAnswer& answer : answers) {
      answer.encoding.probabilities = first_.probabilities;
      answer.encoding.features = Eigen::VectorXf::Zero(1);
    }
    auto released = std::make_shared<std::promise<void>>();
    std::future<void> future = released->get_future();
    shadow_->Offer(
        call, std::move(answers),
        std::shared_ptr<const void>(this, [released](const void*) { released->set_value(); }));
    return future;
  }
  std::future<void> Offer(size_t targets = 1, int64_t bytes = 0) {
    return Offer(Serving(), targets, bytes);
  }
  static bool Released(const std::future<void>& offered) {
    return offered.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }

  double Metric(const std::string& series) const {
    const std::string page = "\n" + metrics_->Page();
    const size_t start = page.find("\n" + series + " ");
    return start == std::string::npos ? -1.0 : std::stod(page.substr(start + series.size() + 2));
  }
  double Targets(const std::string& outcome) const {
    return Metric("maneuver_shadow_targets_total{outcome=\"" + outcome + "\"}");
  }
  // The sum of a histogram of the model.
  double Sum(const std::string& name, const std::string& more_labels = "") const {
    return Metric("maneuver_shadow_" + name + "_sum{model=\"town\"" + more_labels + "}");
  }

  const TemporaryFolder folder_;
  MemoryAliasStore aliases_;
  FakeNetworks first_;
  FakeNetworks candidate_;
  size_t warm_ups_ = 0;  // batches of the candidate that are none of the shadow's
  const std::unique_ptr<monitoring::PrometheusMetrics> metrics_ =
      monitoring::PrometheusMetrics::Create();
  const v1::Scenario scene_ = Scene();
  std::unique_ptr<VersionStore> store_;
  std::unique_ptr<ServingTable> table_;
  std::atomic<bool> busy_ = false;
  std::atomic<int> looks_ = 0;
  std::unique_ptr<Shadow> shadow_;
};

TEST_F(ShadowTest, AnEqualCandidateHasNoDifference) {
  Start();
  Offer(3).wait();
  EXPECT_EQ(Targets("compared"), 3);
  EXPECT_EQ(Targets("dropped"), 0);
  EXPECT_EQ(Targets("failed"), 0);
  for (const char* name : {"expected_trajectory_distance_meters",
                           "likeliest_trajectory_distance_meters", "energy_distance_meters"}) {
    EXPECT_EQ(Sum(name), 0.0) << name;
    EXPECT_EQ(Metric("maneuver_shadow_" + std::string(name) + "_count{model=\"town\"}"), 3) << name;
  }
  EXPECT_EQ(candidate_.batches().size() - warm_ups_, 3U);
}

// Action k stays at (k, k): probabilities 0.2, 0.5, 0.3. The candidate is sure of action 2.
TEST_F(ShadowTest, MeasuresAKnownDifference) {
  candidate_.probabilities = Eigen::Vector3d(0.0, 0.0, 1.0);
  Start();
  Offer().wait();
  const double diagonal = std::sqrt(2.0);
  EXPECT_NEAR(Sum("expected_trajectory_distance_meters"), (2.0 - 1.1) * diagonal, 1e-6);
  EXPECT_NEAR(Sum("likeliest_trajectory_distance_meters"), diagonal, 1e-6);
  const double between = 0.2 * 2.0 + 0.5 * 1.0;
  const double within = 2.0 * (0.2 * 0.5 * 1.0 + 0.2 * 0.3 * 2.0 + 0.5 * 0.3 * 1.0);
  EXPECT_NEAR(Sum("energy_distance_meters"), (2.0 * between - within) * diagonal, 1e-6);
  EXPECT_NEAR(Sum("entropy_nats", ",of=\"answered\""),
              -0.2 * std::log(0.2) - 0.5 * std::log(0.5) - 0.3 * std::log(0.3), 1e-6);
  EXPECT_EQ(Sum("entropy_nats", ",of=\"candidate\""), 0.0);
  // These manifests name no actions: whether they are the same is not known.
  EXPECT_EQ(Metric("maneuver_shadow_divergence_nats_count{model=\"town\"}"), 0.0);
}

TEST_F(ShadowTest, TheCandidateSeesTheSameScene) {
  candidate_.ahead = 5.0;
  Start();
  Offer().wait();
  EXPECT_NEAR(Sum("expected_trajectory_distance_meters"), 5.0, 1e-6);
  EXPECT_NEAR(Sum("likeliest_trajectory_distance_meters"), 5.0, 1e-6);
}

// The answer's encoding was of a target at 3 m/s, which puts its actions 3 m ahead of the
// candidate's.
TEST_F(ShadowTest, ReusesTheEncodingOfTheAnswer) {
  Start();
  PredictionCall call;
  call.model = Serving();
  call.targets = {{&scene_, 7, scene::Pose2(), {}}};
  std::vector<TargetAnswer> answers(1);
  answers[0].encoding.probabilities = first_.probabilities;
  answers[0].encoding.features = Eigen::VectorXf::Zero(1);
  answers[0].encoding.speed = 3.0;
  std::promise<void> released;
  shadow_->Offer(call, std::move(answers),
                 std::shared_ptr<const void>(this, [&](const void*) { released.set_value(); }));
  released.get_future().wait();
  EXPECT_NEAR(Sum("expected_trajectory_distance_meters"), 3.0, 1e-6);
}

TEST_F(ShadowTest, WorksOnlyWhileNoCallsWait) {
  busy_ = true;
  Start();
  const auto offered = Offer();
  const int looks = looks_;
  while (looks_ < looks + 3) std::this_thread::yield();
  EXPECT_EQ(candidate_.batches().size(), warm_ups_);
  EXPECT_FALSE(Released(offered));
  busy_ = false;
  offered.wait();
  EXPECT_EQ(Targets("compared"), 1);
}

TEST_F(ShadowTest, DropsAndCountsRequestsThatDoNotFit) {
  busy_ = true;
  Start({.fraction = 1.0, .max_targets = 3, .max_bytes = 100, .max_share = 1.0});
  const auto first = Offer(2, 60);
  const auto too_many_bytes = Offer(1, 41);
  EXPECT_TRUE(Released(too_many_bytes));
  EXPECT_EQ(Targets("dropped"), 1);
  const auto half = Offer(2, 40);
  EXPECT_EQ(Targets("dropped"), 2);
  const auto full = Offer(1);
  EXPECT_TRUE(Released(full));
  EXPECT_EQ(Targets("dropped"), 3);
  EXPECT_FALSE(Released(first));
  EXPECT_FALSE(Released(half));
  busy_ = false;
  first.wait();
  half.wait();
  EXPECT_EQ(Targets("compared"), 3);
  Offer(3, 100).wait();  // there is room again
  EXPECT_EQ(Targets("compared"), 6);
}

TEST_F(ShadowTest, ABlockedCandidateDelaysNobody) {
  Start({.fraction = 1.0, .max_targets = 2, .max_share = 1.0});
  candidate_.CloseGate();
  const auto standing = Offer();
  candidate_.AwaitBatches(warm_ups_ + 1);
  const auto waiting = Offer();
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(Released(Offer()));
  EXPECT_EQ(Targets("dropped"), 100);
  candidate_.OpenGate();
  standing.wait();
  waiting.wait();
}

TEST_F(ShadowTest, CountsACandidateThatCannotBeLoadedAsFailed) {
  std::ofstream(folder_ / "models" / "town" / "2" / "weights.safetensors") << "altered";
  Open();
  Start();
  EXPECT_TRUE(Released(Offer(2)));
  EXPECT_EQ(Targets("failed"), 2);
  EXPECT_EQ(Targets("compared"), 0);
}

TEST_F(ShadowTest, CountsNonFiniteAnswersOfTheCandidateAsFailed) {
  candidate_.ahead = std::numeric_limits<double>::quiet_NaN();
  Start();
  Offer().wait();
  EXPECT_EQ(Targets("failed"), 1);
  EXPECT_EQ(Targets("compared"), 0);
}

TEST_F(ShadowTest, ACandidateWhoseEngineFailsIsComparedAnewWithTheNextRequest) {
  candidate_.failing_batches = {warm_ups_ + 1};
  Start();
  Offer(3).wait();
  EXPECT_EQ(Targets("compared"), 1);
  EXPECT_EQ(Targets("failed"), 2);
  Offer(3).wait();
  EXPECT_EQ(Targets("compared"), 4);
  EXPECT_EQ(Targets("failed"), 2);
}

TEST_F(ShadowTest, DoesNotCompareFailedTargets) {
  Start();
  PredictionCall call;
  call.model = Serving();
  call.targets.assign(2, {&scene_, 7, scene::Pose2(), {}});
  std::vector<TargetAnswer> answers(2);
  answers[0].status = absl::InternalError("no");
  answers[1].encoding.probabilities = first_.probabilities;
  answers[1].encoding.features = Eigen::VectorXf::Zero(1);
  std::promise<void> released;
  shadow_->Offer(call, std::move(answers),
                 std::shared_ptr<const void>(this, [&](const void*) { released.set_value(); }));
  released.get_future().wait();
  EXPECT_EQ(Targets("compared"), 1);
}

TEST_F(ShadowTest, DoesNothingWithoutACandidate) {
  Start();
  EXPECT_TRUE(Released(Offer(*table_->Find(security::ModelAliasName{"town", "candidate"}))));
  ASSERT_TRUE(table_->DeleteAlias({"town", "candidate"}).ok());
  EXPECT_TRUE(Released(Offer()));
  for (const char* outcome : {"compared", "dropped", "failed"}) EXPECT_EQ(Targets(outcome), 0);
}

TEST_F(ShadowTest, AlwaysSamplesTheSameFractionOfRequests) {
  constexpr int kRequests = 4000;
  const auto sampled = [this](double fraction) {
    Start({.fraction = fraction});
    std::vector<bool> samples;
    for (int i = 0; i < kRequests; ++i) {
      const Target target{&scene_, 7, scene::Pose2(0.1 * i, 0.0, 0.0), {}};
      samples.push_back(shadow_->Samples({&target, 1}));
    }
    return samples;
  };
  const std::vector<bool> some = sampled(0.3);
  // Within four standard deviations.
  EXPECT_NEAR(std::ranges::count(some, true), 0.3 * kRequests,
              4.0 * std::sqrt(0.3 * 0.7 * kRequests));
  EXPECT_EQ(sampled(0.3), some);
  const std::vector<bool> more = sampled(0.6);
  for (size_t i = 0; i < some.size(); ++i) EXPECT_LE(some[i], more[i]);
  EXPECT_EQ(std::ranges::count(sampled(1.0), true), kRequests);
}

TEST_F(ShadowTest, TheThreadSleepsMostOfTheTime) {
  // Whoever asks for the time makes a millisecond pass, so each step takes one.
  std::atomic<int64_t> milliseconds = 0;
  Start({.fraction = 1.0, .max_share = 0.25, .now = [&] {
           return TimePoint(std::chrono::milliseconds(++milliseconds));
         }});
  Offer(8).wait();
  EXPECT_EQ(Targets("compared"), 8);
  const double worked = 1e3 * Metric("maneuver_shadow_seconds_total");
  // Three steps each, and one to begin, which asks for the time itself.
  EXPECT_NEAR(worked, 2.0 + 3.0 * 8.0, 1e-6);
  // After the last step it need not rest.
  EXPECT_GE(static_cast<double>(milliseconds.load()), (worked - 1.0) * 4.0);
}

TEST_F(ShadowTest, ReleasesVersionsThatAreNoLongerCompared) {
  std::atomic<int64_t> seconds = 0;
  Start({.fraction = 1.0, .max_share = 1.0, .now = [&] {
           return TimePoint(std::chrono::seconds(seconds += 20));
         }});
  auto retired = std::make_shared<ServedModel>(security::ModelVersionName{"town", 9},
                                               std::make_shared<FakeActionModel>(first_));
  const std::weak_ptr<ServedModel> watched = retired;
  Offer(retired).wait();
  retired = nullptr;
  EXPECT_EQ(Targets("compared"), 1);
  EXPECT_TRUE(watched.expired());
}

TEST_F(ShadowTest, DropsWaitingRequestsWhenItEnds) {
  busy_ = true;
  Start();
  const auto first = Offer(2);
  const auto second = Offer(2);
  shadow_ = nullptr;
  EXPECT_TRUE(Released(first));
  EXPECT_TRUE(Released(second));
  EXPECT_EQ(Targets("compared"), 0);
}

TEST_F(ShadowTest, ModelsBeyondTheLimitShareMetrics) {
  Start({.fraction = 1.0, .max_share = 1.0, .max_models = 0});
  Offer().wait();
  EXPECT_EQ(Metric("maneuver_shadow_energy_distance_meters_count{model=\"_others\"}"), 1);
  EXPECT_EQ(Metric("maneuver_shadow_energy_distance_meters_count{model=\"town\"}"), -1);
}

}  // namespace
}  // namespace maneuver::serving::shadow_test
