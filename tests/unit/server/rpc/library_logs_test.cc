#include "server/rpc/library_logs.h"

#include <gmock/gmock.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/stubs/logging.h>
#include <google/protobuf/util/json_util.h>
#include <grpc/support/log.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <string>

#include "server/monitoring/logging.h"

namespace maneuver::rpc::library_logs_test {
namespace {

using ::testing::StartsWith;

// Returns the fields of the only line that `write` logs, which must be JSON.
template <typename Write>
google::protobuf::Struct LineOf(const Write& write) {
  ::testing::internal::CaptureStderr();
  write();
  const std::string line = ::testing::internal::GetCapturedStderr();
  google::protobuf::Struct fields;
  EXPECT_TRUE(google::protobuf::util::JsonStringToMessage(line, &fields).ok()) << line;
  return fields;
}

TEST(LibraryLogsTest, LinesOfGrpcAndProtobufAreJsonLikeTheServersOwn) {
  monitoring::ConfigureLogging(monitoring::LogFormat::kJson, monitoring::LogLevel::kInfo);
  LogLibraryLines();
  gpr_log_verbosity_init();  // as gRPC does once it is started
  auto line = LineOf([] { gpr_log(GPR_ERROR, "cannot read \"%s\"\n", "key"); });
  EXPECT_EQ(line.fields().at("level").string_value(), "error");
  EXPECT_EQ(line.fields().at("library").string_value(), "grpc");
  EXPECT_EQ(line.fields().at("text").string_value(), "cannot read \"key\"\n");
  EXPECT_THAT(line.fields().at("source").string_value(), StartsWith("library_logs_test.cc:"));

  line = LineOf([] { GOOGLE_LOG(WARNING) << "not UTF-8"; });
  EXPECT_EQ(line.fields().at("level").string_value(), "warning");
  EXPECT_EQ(line.fields().at("library").string_value(), "protobuf");
  EXPECT_EQ(line.fields().at("text").string_value(), "not UTF-8");
  monitoring::ConfigureLogging(monitoring::LogFormat::kText, monitoring::LogLevel::kInfo);
}

// In a process of its own, which remembers it for ever.
TEST(LibraryLogsDeathTest, TellsThatGrpcHasGivenUpItsPort) {
  LogLibraryLines();
  gpr_log_verbosity_init();
  EXPECT_FALSE(LostListener());
  EXPECT_EXIT(
      {
        gpr_log(GPR_ERROR, "Failed accept4: %s", "Too many open files");
        _exit(LostListener() ? 0 : 1);
      },
      ::testing::ExitedWithCode(0), "accept4");
}

}  // namespace
}  // namespace maneuver::rpc::library_logs_test
