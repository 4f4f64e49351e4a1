// Several ranks learn one model. Here each rank is a thread; tests/ranks has processes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "model/files/durable_file.h"
#include "model/learning/ranks/rank_group.h"
#include "model/learning/ranks/rank_place.h"
#include "model/learning/trainer.h"
#include "model/learning/training_failure.h"
#include "tests/unit/model/learning/analytic_scenes.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::learning::ranks_test {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

EnvironmentReader Environment(std::map<std::string, std::string> variables) {
  return [variables = std::move(variables)](const std::string& name) {
    const auto found = variables.find(name);
    return found == variables.end() ? std::nullopt : std::optional(found->second);
  };
}

TEST(RankPlaceTest, ReadsTheVariablesOfEachLauncher) {
  const auto torchrun = FindRankPlace(Environment({{"RANK", "3"},
                                                   {"WORLD_SIZE", "4"},
                                                   {"LOCAL_RANK", "1"},
                                                   {"LOCAL_WORLD_SIZE", "2"},
                                                   {"MASTER_ADDR", "head"},
                                                   {"MASTER_PORT", "1234"},
                                                   {"TORCHELASTIC_USE_AGENT_STORE", "True"},
                                                   {"TORCHELASTIC_RESTART_COUNT", "2"}}));
  ASSERT_TRUE(torchrun.ok()) << torchrun.status();
  EXPECT_EQ((*torchrun)->rank, 3);
  EXPECT_EQ((*torchrun)->ranks, 4);
  EXPECT_EQ((*torchrun)->local_rank, 1);
  EXPECT_EQ((*torchrun)->local_ranks, 2);
  EXPECT_EQ((*torchrun)->host, "head");
  EXPECT_EQ((*torchrun)->port, 1234);
  EXPECT_EQ((*torchrun)->attempt, "2");
  EXPECT_FALSE((*torchrun)->serves_store);

  const auto slurm = FindRankPlace(Environment({{"SLURM_PROCID", "5"},
                                                {"SLURM_NTASKS", "8"},
                                                {"SLURM_STEP_ID", "0"},
                                                {"SLURM_LOCALID", "1"},
                                                {"SLURM_JOB_ID", "30017"},
                                                {"SLURM_STEP_TASKS_PER_NODE", "4(x2)"},
                                                {"SLURM_STEP_NODELIST", "node[08-09],other"}}));
  ASSERT_TRUE(slurm.ok()) << slurm.status();
  EXPECT_EQ((*slurm)->rank, 5);
  EXPECT_EQ((*slurm)->local_ranks, 4);
  EXPECT_EQ((*slurm)->host, "node08");
  EXPECT_EQ((*slurm)->port, 15'017);
  EXPECT_TRUE((*slurm)->serves_store);

  const auto kubernetes = FindRankPlace(Environment(
      {{"JOB_COMPLETION_INDEX", "1"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "train-0.train"}}));
  ASSERT_TRUE(kubernetes.ok()) << kubernetes.status();
  EXPECT_EQ((*kubernetes)->rank, 1);
  EXPECT_EQ((*kubernetes)->host, "train-0.train");
  EXPECT_EQ((*kubernetes)->port, 29'500);

  const auto open_mpi = FindRankPlace(Environment({{"OMPI_COMM_WORLD_RANK", "1"},
                                                   {"OMPI_COMM_WORLD_SIZE", "2"},
                                                   {"OMPI_COMM_WORLD_LOCAL_RANK", "1"},
                                                   {"OMPI_COMM_WORLD_LOCAL_SIZE", "2"}}));
  ASSERT_TRUE(open_mpi.ok()) << open_mpi.status();
  EXPECT_EQ((*open_mpi)->rank, 1);
  EXPECT_EQ((*open_mpi)->host, "127.0.0.1");
}

TEST(RankPlaceTest, TakesTheFirstLauncherAndNoneOutsideAStep) {
  const auto both = FindRankPlace(Environment({{"RANK", "0"},
                                               {"WORLD_SIZE", "1"},
                                               {"LOCAL_WORLD_SIZE", "1"},
                                               {"SLURM_PROCID", "1"},
                                               {"SLURM_NTASKS", "2"},
                                               {"SLURM_STEP_ID", "0"}}));
  ASSERT_TRUE(both.ok()) << both.status();
  EXPECT_EQ((*both)->ranks, 1);
  // A batch script has the variables of its job, but is not a task of a step.
  const auto script = FindRankPlace(Environment({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "4"}}));
  ASSERT_TRUE(script.ok());
  EXPECT_FALSE(*script);
}

TEST(RankPlaceTest, NamesTheVariableThatIsWrong) {
  const auto message = [](std::map<std::string, std::string> variables) {
    return std::string(FindRankPlace(Environment(std::move(variables))).status().message());
  };
  EXPECT_THAT(message({{"RANK", "0"}, {"WORLD_SIZE", "2"}}), HasSubstr("MASTER_ADDR"));
  EXPECT_THAT(message({{"RANK", "2"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}}),
              HasSubstr("RANK is \"2\", but must be a number from 0 to 1"));
  EXPECT_THAT(message({{"RANK", "0"}, {"WORLD_SIZE", "3"}, {"MASTER_ADDR", "a"}}),
              HasSubstr("power of two"));
  EXPECT_THAT(
      message({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "x"}}),
      HasSubstr("MASTER_PORT"));
}

// Runs one thread for each rank. Each test has a store of its own.
class RanksTest : public testing::Test {
 protected:
  RankPlace Place(int rank, int ranks) const {
    return {.rank = rank,
            .ranks = ranks,
            .host = "127.0.0.1",
            .port = store_->port(),
            .serves_store = false,
            .attempt = std::to_string(attempt_)};
  }

  void ForEachRank(int ranks, const std::function<void(int rank)>& work) {
    ++attempt_;
    std::vector<std::jthread> threads;
    for (int rank = 0; rank < ranks; ++rank) threads.emplace_back([&work, rank] { work(rank); });
  }

  void ForEachGroup(int ranks, const std::function<void(RankGroup&)>& work,
                    const std::function<bool(int rank)>& stopped = nullptr) {
    ForEachRank(ranks, [&](int rank) {
      const auto group =
          RankGroup::Join(Place(rank, ranks), milliseconds(1'000), milliseconds(20'000),
                          [&, rank] { return stopped && stopped(rank); });
      ASSERT_TRUE(group.ok()) << group.status();
      work(**group);
    });
  }

  const std::unique_ptr<RankStore> store_ = *RankStore::Serve();
  int attempt_ = 0;
};

// Adds the rows up in a tree of pairs, one number at a time.
std::vector<float> SumOfPairs(const at::Tensor& rows) {
  if (rows.size(0) == 1) {
    const at::Tensor row = rows[0].contiguous();
    return {row.data_ptr<float>(), row.data_ptr<float>() + row.numel()};
  }
  const int64_t half = rows.size(0) / 2;
  std::vector<float> sum = SumOfPairs(rows.slice(0, 0, half));
  const std::vector<float> rest = SumOfPairs(rows.slice(0, half, 2 * half));
  for (size_t i = 0; i < sum.size(); ++i) sum[i] += rest[i];
  return sum;
}

TEST_F(RanksTest, AddsUpInATreeOfPairsWhateverTheNumberOfRanks) {
  // Sums of these depend on the order.
  const at::Tensor rows = at::empty({8, RankGroup::kSumMultiple}).normal_().exp();
  const std::vector<float> expected = SumOfPairs(rows);
  for (const int ranks : {1, 2, 4, 8}) {
    ForEachGroup(ranks, [&](RankGroup& group) {
      const int64_t share = 8 / ranks;
      at::Tensor mine = at::tensor(
          SumOfPairs(rows.slice(0, group.rank() * share, (group.rank() + 1) * share)), at::kFloat);
      ASSERT_TRUE(group.SumByTree(&mine).ok());
      EXPECT_EQ(
          std::memcmp(mine.data_ptr<float>(), expected.data(), expected.size() * sizeof(float)), 0)
          << ranks << " ranks";
    });
  }
}

TEST_F(RanksTest, NoticesARankThatEndsAtOnceAndAFrozenOneAfterTheTimeOut) {
  std::atomic<bool> over = false;
  for (const bool freezes : {false, true}) {
    over = false;
    ForEachGroup(2, [&](RankGroup& group) {
      if (group.rank() == 1) {
        while (freezes && !over) std::this_thread::yield();
        return;
      }
      const auto begin = std::chrono::steady_clock::now();
      const auto notes = group.Exchange({});
      const auto took = std::chrono::steady_clock::now() - begin;
      over = true;
      EXPECT_EQ(notes.status().code(), absl::StatusCode::kUnavailable) << notes.status();
      EXPECT_EQ(FailureOf(notes.status()), TrainingFailure::kRankLost);
      EXPECT_LT(took, milliseconds(20'000));
      EXPECT_GE(took, milliseconds(freezes ? 900 : 0));
      EXPECT_TRUE(group.StopRequested());
      // It fails at once from then on.
      EXPECT_FALSE(group.SumByTree(nullptr).ok());
    });
  }
}

TEST_F(RanksTest, GivesTheErrorOfOneRankToAll) {
  ForEachGroup(2, [](RankGroup& group) {
    const absl::Status status = group.Apart([&] {
      return group.rank() == 0 ? absl::OkStatus()
                               : WithFailure(absl::FailedPreconditionError("too few"),
                                             TrainingFailure::kNotEnoughExamples);
    });
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_EQ(status.message(), "rank 1: too few");
    EXPECT_EQ(FailureOf(status), TrainingFailure::kNotEnoughExamples);
  });
}

TEST_F(RanksTest, TellsARankThatWorksAloneOfAStopThatAnotherOneGot) {
  std::atomic<bool> stops = false;  // not before both have joined
  ForEachGroup(
      2,
      [&stops](RankGroup& group) {
        const absl::Status status = group.OnRankZero([&] {
          stops = true;
          while (!group.StopRequested()) std::this_thread::yield();
          return absl::CancelledError("heard");
        });
        EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
        EXPECT_TRUE(group.HeardStop());
      },
      [&stops](int rank) { return rank == 1 && stops; });
}

class RankTrainingTest : public RanksTest {
 protected:
  static v1::TrainingSettings Short(v1::TrainingSettings settings) {
    v1::OptimizationSettings& optimization = *settings.mutable_optimization();
    optimization.set_pretraining_epochs(2);
    optimization.set_mixture_epochs(1);
    optimization.set_joint_epochs(2);
    optimization.set_posterior_epochs(1);
    optimization.set_dropout(0.2);
    return settings;
  }

  TrainingRun Run(const v1::TrainingSettings& settings, const std::string& name) const {
    TrainingRun run;
    run.settings = settings;
    run.output = folder_ / name;
    return run;
  }

  // Learns with so many ranks; returns the weights, or "" if one failed.
  std::string Learn(const v1::TrainingSettings& settings, const TrainingData& data, int ranks,
                    std::function<void(TrainingRun&)> change = nullptr) {
    const std::string name = "model" + std::to_string(attempt_);
    std::atomic<int> failed = 0;
    ForEachRank(ranks, [&](int rank) {
      TrainingRun run = Run(settings, name);
      run.rank = Place(rank, ranks);
      if (change) change(run);
      const auto manifest = Train(run, data);
      if (!manifest.ok() && rank == 0) last_error_ = manifest.status();
      if (!manifest.ok()) ++failed;
    });
    return failed > 0 ? "" : *files::ReadFile(folder_ / name / "weights.safetensors");
  }

  const TemporaryFolder folder_;
  absl::Status last_error_;
};

TEST_F(RankTrainingTest, LearnsTheSameWeightsToTheBitWithOneTwoAndFourRanks) {
  // With rasters and batch normalisation, and with vectors and the covariance phase.
  for (const v1::TrainingSettings& settings : {Short(TinySettings()), Short(TinyLanesSettings())}) {
    const TrainingData data = *SplitRecordings(ArcRecordings(36), settings);
    const std::string one = Learn(settings, data, 1);
    ASSERT_NE(one, "") << last_error_;
    EXPECT_TRUE(one == Learn(settings, data, 2)) << last_error_;
    EXPECT_TRUE(one == Learn(settings, data, 4)) << last_error_;
    v1::TrainingSettings other = settings;
    other.set_seed(8);
    EXPECT_FALSE(one == Learn(other, data, 2)) << "the seed has no effect";
  }
}

TEST_F(RankTrainingTest, ResumesWithAnotherNumberOfRanks) {
  const v1::TrainingSettings settings = Short(TinySettings());
  const TrainingData data = *SplitRecordings(ArcRecordings(36), settings);
  const std::string undisturbed = Learn(settings, data, 1);
  const auto keep = [this](TrainingRun& run) { run.checkpoints = folder_ / "checkpoints"; };
  std::atomic<bool> stop = false;
  const std::string stopped = Learn(settings, data, 2, [&](TrainingRun& run) {
    keep(run);
    // Rank 1 alone is asked to stop, in the middle of the joint phase.
    run.progress = [&](const v1::JobProgress& progress) {
      if (progress.phase() == "joint" && progress.epoch() == 2) stop = true;
    };
    const bool hears = run.rank->rank == 1;
    run.stopped = [&stop, hears] { return hears && stop; };
  });
  EXPECT_EQ(stopped, "");
  EXPECT_EQ(last_error_.code(), absl::StatusCode::kCancelled) << last_error_;
  const std::string resumed = Learn(settings, data, 4, keep);
  ASSERT_NE(resumed, "") << last_error_;
  EXPECT_TRUE(resumed == undisturbed);
}

TEST_F(RankTrainingTest, RefusesRanksThatCannotShareTheMicroBatches) {
  v1::TrainingSettings settings = Short(TinySettings());
  settings.mutable_optimization()->set_micro_batches(2);
  const TrainingData data = *SplitRecordings(ArcRecordings(36), settings);
  EXPECT_EQ(Learn(settings, data, 4), "");
  EXPECT_THAT(std::string(last_error_.message()), HasSubstr("optimization.micro_batches is 2"));
}

}  // namespace
}  // namespace maneuver::learning::ranks_test
