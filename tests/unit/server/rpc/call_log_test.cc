#include "server/rpc/call_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <string>

#include "server/monitoring/logging.h"

namespace maneuver::rpc::call_log_test {
namespace {

using monitoring::LogLevel;
using ::testing::HasSubstr;
using ::testing::Not;

// The specification's own example.
constexpr char kTraceparent[] = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";

class CallLogTest : public ::testing::Test {
 protected:
  void TearDown() override { monitoring::SetLogLevel(LogLevel::kInfo); }

  std::string Line(LogLevel level, grpc::StatusCode code, const CallOrigin& origin) {
    monitoring::SetLogLevel(level);
    ::testing::internal::CaptureStderr();
    log_.Write({.method = "PredictionService/Predict",
                .code = code,
                .time = std::chrono::milliseconds(250),
                .request_bytes = 7,
                .response_bytes = 9},
               origin);
    return ::testing::internal::GetCapturedStderr();
  }

  CallLog log_{0xabcu};
};

TEST_F(CallLogTest, KeepsTheCallersTraceAndRequestId) {
  const CallOrigin origin = log_.OriginOf("plan-17.3_a", kTraceparent);
  EXPECT_EQ(origin.request_id, "plan-17.3_a");
  EXPECT_EQ(origin.traceparent, kTraceparent);
}

TEST_F(CallLogTest, MakesUpARequestIdIfTheCallHasNone) {
  EXPECT_EQ(log_.OriginOf("", "").request_id, "00000abc-1");
  EXPECT_EQ(log_.OriginOf("", "").request_id, "00000abc-2");
}

TEST_F(CallLogTest, IgnoresMalformedRequestIdsAndTraceparents) {
  for (const std::string& id : {std::string("two words"), std::string("a\nb"), std::string("a=b"),
                                std::string("\""), std::string(65, 'a')}) {
    EXPECT_THAT(log_.OriginOf(id, "").request_id, ::testing::StartsWith("00000abc-")) << id;
  }
  EXPECT_EQ(log_.OriginOf(std::string(64, 'a'), "").request_id, std::string(64, 'a'));
  for (const char* traceparent :
       {"", "00", "00-0AF7651916CD43DD8448EB211C80319C-b7ad6b7169203331-01",
        "00-00000000000000000000000000000000-b7ad6b7169203331-01",
        "00-0af7651916cd43dd8448eb211c80319c-0000000000000000-01",
        "ff-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
        "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01-extra",
        "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-0g",
        "00_0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
        "01-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01more"}) {
    EXPECT_EQ(log_.OriginOf("", traceparent).traceparent, "") << traceparent;
  }
}

TEST_F(CallLogTest, ReadsTheKnownPartOfALaterTraceparentVersion) {
  const std::string later = "01-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
  EXPECT_EQ(log_.OriginOf("", later).traceparent, later);
  EXPECT_EQ(log_.OriginOf("", later + "-more=\"x\"").traceparent, later);
}

TEST_F(CallLogTest, LogsEveryCallOnlyAtDebug) {
  const CallOrigin origin{"r1", kTraceparent};
  EXPECT_THAT(Line(LogLevel::kDebug, grpc::StatusCode::OK, origin),
              HasSubstr(" call method=PredictionService/Predict code=OK seconds=0.25 "
                        "request_bytes=7 response_bytes=9 request_id=r1 traceparent=" +
                        std::string(kTraceparent) + "\n"));
  EXPECT_EQ(Line(LogLevel::kInfo, grpc::StatusCode::OK, origin), "");
  EXPECT_EQ(Line(LogLevel::kInfo, grpc::StatusCode::INVALID_ARGUMENT, origin), "");
  EXPECT_THAT(Line(LogLevel::kDebug, grpc::StatusCode::OK, {"r1", ""}),
              Not(HasSubstr("traceparent")));
}

TEST_F(CallLogTest, LogsServerFaultsAsErrorsAtALimitedRate) {
  int lines = 0;
  for (int i = 0; i < 100; ++i) {
    const std::string line = Line(LogLevel::kError, grpc::StatusCode::INTERNAL, {"r", ""});
    if (line.empty()) continue;
    ++lines;
    EXPECT_THAT(line, AllOf(HasSubstr("error"), HasSubstr("call failed"), HasSubstr("INTERNAL")));
  }
  EXPECT_GE(lines, 10);
  EXPECT_LT(lines, 50);
}

}  // namespace
}  // namespace maneuver::rpc::call_log_test
