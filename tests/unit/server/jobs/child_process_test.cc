#include "server/jobs/child_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <vector>

#include "model/files/durable_file.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::jobs::child_process_test {
namespace {

using testing::ElementsAre;

class ChildProcessTest : public testing::Test {
 protected:
  absl::StatusOr<ChildResult> RunShell(const std::string& script) {
    return RunChild(
        {.arguments = {"sh", "-c", script}, .log = folder_ / "log"}, stop_,
        [this](const std::string& line) { lines_.push_back(line); }, [] {});
  }

  const TemporaryFolder folder_;
  StopRequest stop_;
  std::vector<std::string> lines_;
};

TEST_F(ChildProcessTest, ReportsLinesExitStatusAndErrors) {
  const auto result = RunShell("echo a; echo why >&2; printf 'b\\nhalf'; exit 65");
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->exit_status, 65);
  EXPECT_EQ(result->signal, 0);
  EXPECT_THAT(lines_, ElementsAre("a", "b"));
  EXPECT_EQ(*files::ReadFile(folder_ / "log"), "why\n");
}

TEST_F(ChildProcessTest, EndsIfSomebodyElseReapsTheProcess) {
  const auto before = signal(SIGCHLD, SIG_IGN);  // then the kernel does
  const auto result = RunShell("echo a");
  signal(SIGCHLD, before);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->signal, SIGKILL);  // nobody knows how it ended
  EXPECT_THAT(lines_, ElementsAre("a"));
}

TEST_F(ChildProcessTest, ReadsLargeOutputWhole) {
  ASSERT_TRUE(RunShell("i=0; while [ $i -lt 20000 ]; do echo $i; i=$((i+1)); done").ok());
  ASSERT_EQ(lines_.size(), 20'000u);
  EXPECT_EQ(lines_.back(), "19999");
}

TEST_F(ChildProcessTest, SkipsAnEndlessLineWithoutUsingMemory) {
  ASSERT_TRUE(RunShell("head -c 3000000 /dev/zero | tr '\\0' x; echo; echo after").ok());
  EXPECT_THAT(lines_, ElementsAre("after"));
}

TEST_F(ChildProcessTest, AKillDoesNotWaitForTheProcessNorForWhoReadsItsLines) {
  const auto result = RunChild(
      {.arguments = {"sh", "-c", "trap '' TERM; echo ready; while :; do sleep 0.02; done"},
       .log = folder_ / "log",
       .patience = std::chrono::hours(1)},
      stop_, [this](const std::string&) { stop_.Kill(StopRequest::Reason::kLeaseLost); }, [] {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->signal, SIGKILL);
  EXPECT_EQ(stop_.reason(), StopRequest::Reason::kLeaseLost);
}

TEST_F(ChildProcessTest, AKillThatComesFirstKillsTheProcessAtOnce) {
  stop_.Kill(StopRequest::Reason::kLeaseLost);
  const auto result = RunChild(
      {.arguments = {"sh", "-c", "trap '' TERM; sleep 3600"},
       .log = folder_ / "log",
       .patience = std::chrono::hours(1)},
      stop_, [](const std::string&) {}, [] {});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->signal, SIGKILL);
}

TEST_F(ChildProcessTest, ReportsASignal) {
  const auto result = RunShell("kill -9 $$");
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->signal, SIGKILL);
}

TEST_F(ChildProcessTest, RefusesAMissingProgram) {
  const auto result = RunChild(
      {.arguments = {folder_ / "none"}, .log = folder_ / "log"}, stop_, [](const std::string&) {},
      [] {});
  EXPECT_TRUE(absl::IsNotFound(result.status())) << result.status();
}

TEST_F(ChildProcessTest, RunsWithoutInputAtLowPriorityInItsOwnGroup) {
  // Group and niceness, as proc(5) numbers the fields.
  ASSERT_TRUE(RunShell("cat; cut -d' ' -f5,19 /proc/$$/stat; echo $$").ok());
  const int mine = getpriority(PRIO_PROCESS, 0);
  ASSERT_EQ(lines_.size(), 2u);
  EXPECT_EQ(lines_[0], lines_[1] + " " + std::to_string(std::max(mine, 19)));
}

TEST_F(ChildProcessTest, YieldsProcessorAndDiskToTheServer) {
  // The scheduling policy, as proc(5) numbers the fields: SCHED_IDLE is 5.
  ASSERT_TRUE(RunShell("cut -d' ' -f41 /proc/self/stat; ionice -p $$").ok());
  EXPECT_THAT(lines_, ElementsAre("5", "best-effort: prio 7"));
}

TEST_F(ChildProcessTest, IsKilledIfItExceedsItsMemoryLimit) {
  ChildCommand command{.arguments = {"perl", "-e", "my $held = 'x' x 200_000_000; sleep 30;"},
                       .log = folder_ / "log"};
  command.memory_limit_bytes = 100 << 20;
  const auto killed = RunChild(
      command, stop_, [](const std::string&) {}, [] {});
  ASSERT_TRUE(killed.ok());
  EXPECT_TRUE(killed->over_memory_limit);
  EXPECT_EQ(killed->signal, SIGKILL);
  command.arguments = {"sleep", "0.3"};
  EXPECT_FALSE(RunChild(
                   command, stop_, [](const std::string&) {}, [] {})
                   ->over_memory_limit);
}

TEST_F(ChildProcessTest, IsStoppedWhenItsTimeIsUp) {
  ChildCommand command{.arguments = {"sh", "-c", "while :; do sleep 0.02; done"},
                       .log = folder_ / "log"};
  command.time_limit = std::chrono::milliseconds(50);
  const auto late = RunChild(
      command, stop_, [](const std::string&) {}, [] {});
  ASSERT_TRUE(late.ok());
  EXPECT_TRUE(late->timed_out);
  EXPECT_EQ(late->signal, SIGTERM);
  command.arguments = {"true"};
  command.time_limit = std::chrono::hours(1);
  EXPECT_FALSE(RunChild(
                   command, stop_, [](const std::string&) {}, [] {})
                   ->timed_out);
}

TEST_F(ChildProcessTest, IsStoppedEvenIfItWritesFasterThanItsLinesAreTaken) {
  constexpr int kTooMany = 300'000;
  ChildCommand command{.arguments = {"yes"}, .log = folder_ / "log"};
  command.time_limit = std::chrono::milliseconds(50);
  command.yields = false;
  int lines = 0;
  const auto take = [&](const std::string&) {
    const auto taken = std::chrono::steady_clock::now() + std::chrono::microseconds(5);
    while (std::chrono::steady_clock::now() < taken) {
    }
    if (++lines == kTooMany) stop_.Kill(StopRequest::Reason::kCancelled);  // ends the test
  };
  const auto late = RunChild(command, stop_, take, [] {});
  ASSERT_TRUE(late.ok()) << late.status();
  EXPECT_TRUE(late->timed_out);
  EXPECT_LT(lines, kTooMany);
}

TEST_F(ChildProcessTest, InheritsNoDescriptors) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);  // not close-on-exec
  ASSERT_TRUE(RunShell("ls /proc/self/fd | wc -l").ok());
  close(ends[0]);
  close(ends[1]);
  // 0, 1, 2, and the folder that ls reads.
  EXPECT_THAT(lines_, ElementsAre("4"));
}

TEST_F(ChildProcessTest, AStopRequestBeforeTheStartStopsIt) {
  stop_.Stop(StopRequest::Reason::kCancelled);
  stop_.Stop(StopRequest::Reason::kServerStops);
  const auto result = RunShell("while :; do sleep 1; done");
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->signal, SIGTERM);
  EXPECT_EQ(stop_.reason(), StopRequest::Reason::kCancelled);
}

TEST_F(ChildProcessTest, KillsTheProcessesThatItLeavesBehind) {
  // Orphans come to this process, which can then wait for their end.
  ASSERT_EQ(prctl(PR_SET_CHILD_SUBREAPER, 1), 0);
  ASSERT_TRUE(RunShell("sleep 1000 & echo $!").ok());
  ASSERT_EQ(lines_.size(), 1u);
  int status = 0;
  EXPECT_EQ(waitpid(std::stoi(lines_[0]), &status, 0), std::stoi(lines_[0]));
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  prctl(PR_SET_CHILD_SUBREAPER, 0);
}

TEST_F(ChildProcessTest, DiesWithItsServer) {
  ASSERT_EQ(prctl(PR_SET_CHILD_SUBREAPER, 1), 0);
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t server = fork();
  if (server == 0) {
    StopRequest stop;
    RunChild(
        {.arguments = {"sh", "-c", "echo $$; exec sleep 1000"}, .log = folder_ / "log"}, stop,
        [&](const std::string& line) {
          if (write(ends[1], line.data(), line.size()) < 0) _exit(1);
          close(ends[1]);
        },
        [] {})
        .IgnoreError();
    _exit(0);
  }
  close(ends[1]);
  char text[32] = {};
  ASSERT_GT(read(ends[0], text, sizeof text - 1), 0);
  close(ends[0]);
  kill(server, SIGKILL);
  ASSERT_EQ(waitpid(server, nullptr, 0), server);
  int status = 0;
  EXPECT_EQ(waitpid(std::stoi(text), &status, 0), std::stoi(text));
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  prctl(PR_SET_CHILD_SUBREAPER, 0);
}

}  // namespace
}  // namespace maneuver::jobs::child_process_test
