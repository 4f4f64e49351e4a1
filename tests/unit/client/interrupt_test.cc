// Ctrl-C while a dataset is written: nothing is left of it.

#include "client/cli/interrupt.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "client/cli/command.h"
#include "client/cli/maneuver.h"
#include "model/artifact/model_folder.h"
#include "model/data/tfrecord.h"
#include "tests/unit/client/run_maneuver.h"
#include "tests/unit/model/artifact/tiny_model.h"
#include "tests/unit/model/data/wire_format.h"
#include "tests/unit/model/inference/reference_model.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::cli::interrupt_test {
namespace {

using data::Wire;
using testing::HasSubstr;
using testing::IsEmpty;

// Runs a command that writes a dataset into the folder. Presses Ctrl-C once it has begun to.
// Returns what it says on standard error.
std::string Interrupted(const std::vector<std::string>& command, const TemporaryFolder& folder) {
  std::signal(SIGINT, SIG_DFL);  // whatever the shell has set
  std::atomic<bool> is_over = false;
  std::thread interrupter([&] {
    while (!is_over && folder.Names().empty()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    if (!is_over) kill(getpid(), SIGINT);
  });
  std::istringstream in;
  std::ostringstream out, err;
  Environment environment(in, out, err);
  const int status = RunManeuver(command, environment);
  is_over = true;
  interrupter.join();
  EXPECT_NE(status, 0) << out.str();
  return err.str();
}

TEST(InterruptTest, LeavesNothingOfASynthesizedDataset) {
  const TemporaryFolder folder;
  const std::string err =
      Interrupted({"synthesize", (folder / "town").string(), "--recordings", "100000"}, folder);
  EXPECT_THAT(err, HasSubstr("interrupted"));
  EXPECT_THAT(folder.Names(), IsEmpty());
}

TEST(InterruptTest, LeavesNothingOfAnImport) {
  const TemporaryFolder folder;
  const TemporaryFolder source;
  Wire track = Wire().Varint(1, 1).Varint(2, 1);
  Wire recording;
  for (int i = 0; i < 3; ++i) {
    recording.Double(1, 0.1 * i);
    track.Message(3,
                  Wire().Double(2, i).Double(3, 0.0).Float(5, 4.5F).Float(6, 2.0F).Varint(11, 1));
  }
  const std::string bytes = recording.Message(2, track).Bytes(5, "a").Varint(10, 1).bytes();
  auto writer = data::TfRecordWriter::Create(source / "many.tfrecord");
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int i = 0; i < 100'000; ++i) ASSERT_TRUE((*writer)->Append(bytes).ok());
  ASSERT_TRUE((*writer)->Close().ok());
  const std::string err = Interrupted(
      {"import", "waymo", (folder / "imported").string(), (source / "many.tfrecord").string()},
      folder);
  EXPECT_THAT(err, HasSubstr("interrupted"));
  EXPECT_THAT(folder.Names(), IsEmpty());
}

TEST(InterruptTest, LeavesNothingOfADatasetOfFoundRecordings) {
  const TemporaryFolder folder;
  const TemporaryFolder source;
  ASSERT_TRUE(
      artifact::WriteModelFolder(source / "model", inference::RandomModel(artifact::TinySpec(), 1))
          .ok());
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"synthesize", source / "town", "--recordings", "60"},
                                             {"tag", source / "town", "--model", source / "model",
                                              "-o", source / "tags", "--stride", "5"}}) {
    const Result result = Maneuver(command);
    ASSERT_EQ(result.status, kOk) << result.err;
  }
  const std::string err =
      Interrupted({"find", source / "tags", "--surprise", "top:2000", "--dataset", source / "town",
                   "--as-dataset", folder / "found"},
                  folder);
  EXPECT_THAT(err, HasSubstr("interrupted"));
  EXPECT_THAT(folder.Names(), IsEmpty());
}

TEST(InterruptTest, LeavesAnIgnoredSignalIgnored) {
  std::signal(SIGINT, SIG_IGN);  // as a shell does for what a script starts with &
  {
    const Interrupt interrupt([] {});
    raise(SIGINT);
  }
  EXPECT_TRUE(std::signal(SIGINT, SIG_DFL) == SIG_IGN);
}

}  // namespace
}  // namespace maneuver::cli::interrupt_test
