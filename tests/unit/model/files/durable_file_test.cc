#include "model/files/durable_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/files/errno_status.h"
#include "model/files/output_file.h"
#include "tests/unit/temporary_folder.h"

namespace maneuver::files::durable_file_test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::UnorderedElementsAre;

class DurableFileTest : public testing::Test {
 protected:
  const TemporaryFolder folder_;
};

TEST_F(DurableFileTest, WritesAndReplacesWithoutLeavingATemporary) {
  const std::string binary("\0\x01\n\xff", 4);
  ASSERT_TRUE(WriteFileAtomically(folder_ / "a", "first").ok());
  ASSERT_TRUE(WriteFileAtomically(folder_ / "a", binary).ok());
  EXPECT_EQ(*ReadFile(folder_ / "a"), binary);
  EXPECT_THAT(folder_.Names(), ElementsAre("a"));
}

TEST_F(DurableFileTest, ReadsAFileLargerThanTheBuffer) {
  const std::string content(300'001, 'x');
  WriteBytes(folder_ / "large", content);
  EXPECT_EQ(*ReadFile(folder_ / "large"), content);
}

TEST_F(DurableFileTest, AMissingFileIsNotFoundAndNamedWithoutItsFolder) {
  const auto content = ReadFile(folder_ / "absent");
  EXPECT_EQ(content.status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(content.status().message(), "cannot open absent: no such file or folder");
}

TEST_F(DurableFileTest, WhatIsNotAFileIsRefusedAndNotWaitedFor) {
  const fs::path pipe = folder_.path() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  for (const fs::path& path : {pipe, folder_.path(), fs::path("/dev/zero")}) {
    const absl::Status refused = ReadFile(path).status();
    EXPECT_TRUE(absl::IsDataLoss(refused)) << refused;
  }
}

TEST_F(DurableFileTest, InputMayBeAPipe) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  ASSERT_EQ(write(ends[1], "abc", 3), 3);
  close(ends[1]);
  const auto content = ReadInput(absl::StrCat("/dev/fd/", ends[0]));
  ASSERT_TRUE(content.ok()) << content.status();
  EXPECT_EQ(*content, "abc");
  EXPECT_TRUE(absl::IsDataLoss(ReadInput(folder_.path()).status()));
  close(ends[0]);
}

TEST_F(DurableFileTest, AFailedWriteLeavesTheOldContentAndNoTemporary) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / "a", "old").ok());
  // A limit on file size simulates a full disk.
  struct rlimit before {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = signal(SIGXFSZ, SIG_IGN);
  struct rlimit limited = before;
  limited.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limited), 0);
  const absl::Status status = WriteFileAtomically(folder_ / "a", std::string(5000, 'x'));
  setrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, handler);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_EQ(*ReadFile(folder_ / "a"), "old");
  EXPECT_THAT(folder_.Names(), ElementsAre("a"));
}

TEST_F(DurableFileTest, ReplacingAFolderByAFileFailsAndLeavesNoTemporary) {
  fs::create_directory(folder_ / "taken");
  EXPECT_FALSE(WriteFileAtomically(folder_ / "taken", "x").ok());
  EXPECT_THAT(folder_.Names(), ElementsAre("taken"));
}

TEST_F(DurableFileTest, PublishesAFolderWithEverythingInIt) {
  const auto temporary = MakeTemporaryFolderFor(folder_ / "model");
  ASSERT_TRUE(temporary.ok()) << temporary.status();
  EXPECT_EQ(temporary->parent_path(), folder_.path());
  WriteBytes(*temporary / "weights", "w");
  fs::create_directory(*temporary / "inner");
  WriteBytes(*temporary / "inner" / "file", "f");
  ASSERT_TRUE(PublishFolder(*temporary, folder_ / "model").ok());
  EXPECT_THAT(folder_.Names(), ElementsAre("model"));
  EXPECT_EQ(*ReadFile(folder_ / "model" / "weights"), "w");
  EXPECT_EQ(*ReadFile(folder_ / "model" / "inner" / "file"), "f");
}

TEST_F(DurableFileTest, DoesNotPublishOverSomethingThatExists) {
  fs::create_directory(folder_ / "model");  // empty: a plain rename would replace it
  const auto temporary = MakeTemporaryFolderFor(folder_ / "model");
  ASSERT_TRUE(temporary.ok());
  WriteBytes(*temporary / "weights", "w");
  EXPECT_EQ(PublishFolder(*temporary, folder_ / "model").code(), absl::StatusCode::kAlreadyExists);
  EXPECT_TRUE(fs::exists(*temporary / "weights"));
  EXPECT_TRUE(fs::is_empty(folder_ / "model"));
}

TEST_F(DurableFileTest, TemporaryFoldersOfOneNameDiffer) {
  const auto first = MakeTemporaryFolderFor(folder_ / "model");
  const auto second = MakeTemporaryFolderFor(folder_ / "model/");
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_NE(*first, *second);
  EXPECT_EQ(second->parent_path(), folder_.path());
  EXPECT_THAT(first->filename().string(), testing::StartsWith(".model.tmp-"));
  EXPECT_THAT(second->filename().string(), testing::StartsWith(".model.tmp-"));
}

TEST_F(DurableFileTest, MovesAFolderAsideUnderTheNameOfATemporary) {
  fs::create_directory(folder_ / "model");
  WriteBytes(folder_ / "model" / "weights", "w");
  const auto aside = MoveAside(folder_ / "model");
  ASSERT_TRUE(aside.ok()) << aside.status();
  EXPECT_EQ(aside->parent_path(), folder_.path());
  EXPECT_EQ(*ReadFile(*aside / "weights"), "w");
  EXPECT_EQ(folder_.Names().size(), 1u) << "the folder is gone from its place";
  EXPECT_EQ(MoveAside(folder_ / "model").status().code(), absl::StatusCode::kNotFound);
  ASSERT_TRUE(RemoveTemporaries(folder_.path()).ok());
  EXPECT_THAT(folder_.Names(), testing::IsEmpty());
}

TEST_F(DurableFileTest, RemovesTemporariesAndNothingElse) {
  ASSERT_TRUE(MakeTemporaryFolderFor(folder_ / "model").ok());
  WriteBytes(folder_ / ".file.tmp-12", "half");
  WriteBytes(folder_ / "notes.tmp-12", "not hidden: not ours");
  WriteBytes(folder_ / ".hidden", "");
  fs::create_directory(folder_ / "model");
  ASSERT_TRUE(RemoveTemporaries(folder_.path()).ok());
  EXPECT_THAT(folder_.Names(), UnorderedElementsAre("notes.tmp-12", ".hidden", "model"));
}

TEST_F(DurableFileTest, RemovingTemporariesOfAMissingFolderIsNotFound) {
  EXPECT_EQ(RemoveTemporaries(folder_ / "absent").code(), absl::StatusCode::kNotFound);
}

TEST(ErrnoStatusTest, MapsErrorsToActionableStatuses) {
  const fs::path file = "/var/secret/place/weights.safetensors";
  EXPECT_EQ(ErrnoStatus(ENOSPC, "write", file),
            absl::ResourceExhaustedError("cannot write weights.safetensors: the disk is full"));
  EXPECT_EQ(ErrnoStatus(EACCES, "open", file),
            absl::PermissionDeniedError("cannot open weights.safetensors: permission denied"));
  EXPECT_EQ(ErrnoStatus(EROFS, "create", file).code(), absl::StatusCode::kPermissionDenied);
  EXPECT_EQ(ErrnoStatus(EDQUOT, "write", file).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ErrnoStatus(EEXIST, "create", file).code(), absl::StatusCode::kAlreadyExists);
  // An error without a message of its own.
  const absl::Status other = ErrnoStatus(EISDIR, "open", file);
  EXPECT_FALSE(other.ok());
  EXPECT_THAT(std::string(other.message()), Not(HasSubstr("secret")));
}

TEST_F(DurableFileTest, OutputFileKeepsOrderAcrossSmallAndLargeWrites) {
  const auto output = OutputFile::Create(folder_ / "out");
  ASSERT_TRUE(output.ok());
  std::string expected;
  for (const size_t size : {3u, 200'000u, 100'000u, 700'000u, 1u, 0u}) {
    const std::string piece(size, static_cast<char>('a' + expected.size() % 26));
    ASSERT_TRUE((*output)->Append(piece).ok());
    expected += piece;
  }
  EXPECT_EQ((*output)->size_bytes(), static_cast<int64_t>(expected.size()));
  ASSERT_TRUE((*output)->Close().ok());
  EXPECT_EQ(*ReadFile(folder_ / "out"), expected);
}

TEST_F(DurableFileTest, OutputFileNeverOverwrites) {
  WriteBytes(folder_ / "out", "kept");
  EXPECT_EQ(OutputFile::Create(folder_ / "out").status().code(), absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(*ReadFile(folder_ / "out"), "kept");
}

}  // namespace
}  // namespace maneuver::files::durable_file_test
