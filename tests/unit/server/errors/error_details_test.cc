#include "server/errors/error_details.h"

#include <gtest/gtest.h>

#include <cerrno>
#include <string>
#include <vector>

#include "maneuver/v1/status.pb.h"
#include "model/files/errno_status.h"

namespace maneuver::errors::error_details_test {
namespace {

TEST(InvalidFieldsTest, ListsSixteenAndCountsTheOthers) {
  const std::vector<scene::FieldViolation> violations(1000, {"weights", "is wrong"});
  const absl::Status status = InvalidFields(violations);
  EXPECT_EQ(status.message(), "weights: is wrong (and 999 more)");
  v1::BadRequest listed;
  const auto detail = status.GetPayload("type.googleapis.com/google.rpc.BadRequest");
  ASSERT_TRUE(detail.has_value());
  ASSERT_TRUE(listed.ParseFromString(std::string(*detail)));
  ASSERT_EQ(listed.field_violations_size(), 16);
  EXPECT_EQ(listed.field_violations(14).description(), "is wrong");
  EXPECT_EQ(listed.field_violations(15).description(), "is wrong (and 984 more fields are wrong)");
}

TEST(InvalidFieldsTest, CountsWhatAListHasLeftOut) {
  std::vector<scene::FieldViolation> violations(16, {"weights", "is wrong"});
  violations.back().others = 84;
  const absl::Status status = InvalidFields(violations);
  EXPECT_EQ(status.message(), "weights: is wrong (and 99 more)");
  v1::BadRequest listed;
  ASSERT_TRUE(listed.ParseFromString(
      std::string(*status.GetPayload("type.googleapis.com/google.rpc.BadRequest"))));
  ASSERT_EQ(listed.field_violations_size(), 16);
  EXPECT_EQ(listed.field_violations(15).description(), "is wrong (and 84 more fields are wrong)");
}

TEST(StorageReasonTest, MapsDiskErrorsWithoutBlamingTheCaller) {
  const absl::Status full = WithStorageReason(absl::ResourceExhaustedError("the disk is full"));
  EXPECT_EQ(full.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(full), "DISK_FULL");
  const absl::Status damaged = WithStorageReason(absl::DataLossError("malformed"));
  EXPECT_EQ(damaged.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(ReasonOf(damaged), "STORAGE_DAMAGED");
  const absl::Status forbidden = WithStorageReason(absl::PermissionDeniedError("cannot open x"));
  EXPECT_EQ(forbidden.code(), absl::StatusCode::kInternal);
  EXPECT_EQ(forbidden.message(), "cannot open x");
  EXPECT_EQ(ReasonOf(forbidden), "STORAGE_INACCESSIBLE");
}

TEST(StorageReasonTest, KeepsAnExistingReason) {
  const absl::Status known = WithReason(absl::ResourceExhaustedError("busy"), "QUEUE_FULL");
  EXPECT_EQ(ReasonOf(WithStorageReason(known)), "QUEUE_FULL");
  const absl::Status none = WithStorageReason(absl::NotFoundError("none"));
  EXPECT_EQ(none.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReasonOf(none), "");
}

TEST(FolderReasonTest, AFileSystemThatFailsIsUnavailableAndNamesTheFolder) {
  for (const int error : {ENOTCONN, EIO, ESTALE, ETIMEDOUT, EHOSTDOWN}) {
    const absl::Status status =
        WithFolderReason(files::ErrnoStatus(error, "create", "/data/datasets/.lock"), "datasets");
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
    EXPECT_EQ(ReasonOf(status), "FOLDER_UNAVAILABLE");
    EXPECT_NE(status.message().find("its folder datasets: cannot create .lock"), std::string::npos);
    EXPECT_TRUE(RetryDelay(status).has_value());
    v1::ErrorInfo info;
    info.ParseFromString(
        std::string(*status.GetPayload("type.googleapis.com/google.rpc.ErrorInfo")));
    EXPECT_EQ(info.metadata().at("folder"), "datasets");
    EXPECT_EQ(ReasonOf(WithStorageReason(files::ErrnoStatus(error, "write", "/data/x"))),
              "FOLDER_UNAVAILABLE");
  }
}

TEST(FolderReasonTest, LeavesErrorsOfASingleFileAlone) {
  for (const int error : {ENOENT, ENOSPC, EACCES, EISDIR}) {
    const absl::Status status = files::ErrnoStatus(error, "create", "/data/datasets/town");
    EXPECT_EQ(WithFolderReason(status, "datasets"), status);
  }
  EXPECT_TRUE(WithFolderReason(absl::OkStatus(), "datasets").ok());
  const absl::Status known = WithReason(files::ErrnoStatus(EIO, "read", "x"), "MODEL_DAMAGED");
  EXPECT_EQ(ReasonOf(WithFolderReason(known, "models")), "MODEL_DAMAGED");
}

}  // namespace
}  // namespace maneuver::errors::error_details_test
