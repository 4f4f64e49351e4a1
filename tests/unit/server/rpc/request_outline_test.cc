#include "server/rpc/request_outline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::rpc::request_outline_test {
namespace {

// In slices of so many bytes, as a network delivers them.
grpc::ByteBuffer InSlices(const std::string& bytes, size_t size) {
  std::vector<grpc::Slice> slices;
  for (size_t i = 0; i < bytes.size(); i += size) slices.emplace_back(bytes.substr(i, size));
  return {slices.data(), slices.size()};
}

v1::StreamPredictRequest Request() {
  v1::StreamPredictRequest request;
  request.set_request_id("cycle 7");
  request.mutable_timeout()->set_seconds(1);
  request.mutable_timeout()->set_nanos(500);
  for (int i = 0; i < 10; ++i) {
    auto& scenario = *request.mutable_request()->add_scenarios();
    scenario.set_map_id("a map");
    for (int id = 0; id < i; ++id) scenario.add_target_ids(id % 2 == 0 ? -1 : 1000);
  }
  return request;
}

TEST(StreamOutlineTest, ReadsIdAndTimeoutHoweverTheMessageIsSliced) {
  const std::string bytes = Request().SerializeAsString();
  for (const size_t size : {size_t{1}, size_t{7}, bytes.size()}) {
    const grpc::ByteBuffer message = InSlices(bytes, size);
    const auto outline = ReadStreamOutline(message);
    ASSERT_TRUE(outline.has_value());
    EXPECT_EQ(outline->request_id, "cycle 7");
    ASSERT_TRUE(outline->timeout.has_value());
    EXPECT_EQ(outline->timeout->seconds(), 1);
    EXPECT_EQ(outline->timeout->nanos(), 500);
    EXPECT_EQ(outline->targets, 45u);
    EXPECT_EQ(message.Length(), bytes.size());  // and nothing is taken away
  }
}

TEST(StreamOutlineTest, OmitsFieldsThatAreNotSet) {
  const auto outline = ReadStreamOutline(InSlices("", 1));
  ASSERT_TRUE(outline.has_value());
  EXPECT_EQ(outline->request_id, "");
  EXPECT_FALSE(outline->timeout.has_value());
}

TEST(StreamOutlineTest, DoesNotParseTheScenes) {
  // Field 2, three bytes that are not a message; then field 1.
  const auto outline = ReadStreamOutline(InSlices(std::string("\x12\x03\xff\xff\xff\x0a\x01z"), 2));
  ASSERT_TRUE(outline.has_value());
  EXPECT_EQ(outline->request_id, "z");
  EXPECT_EQ(outline->targets, 0u);
}

TEST(StreamOutlineTest, RefusesATruncatedMessage) {
  const std::string bytes = Request().SerializeAsString();
  EXPECT_FALSE(ReadStreamOutline(InSlices(bytes.substr(0, bytes.size() - 1), 5)).has_value());
  EXPECT_FALSE(ReadStreamOutline(InSlices(std::string(3, '\0'), 1)).has_value());
  EXPECT_FALSE(ReadStreamOutline(InSlices("\xff\xff\xff", 3)).has_value());
}

TEST(CountTargetsTest, CountsTheTargetsOfAllScenarios) {
  const auto count = [](const google::protobuf::Message& request) {
    return CountTargets(InSlices(request.SerializeAsString(), 5));
  };
  EXPECT_EQ(count(Request().request()), 45u);
  EXPECT_EQ(count(v1::PredictRequest()), 0u);
  v1::ClassifyTrajectoriesRequest classify;
  classify.add_scenarios()->add_target_ids(3);
  EXPECT_EQ(count(classify), 1u);
}

TEST(CountTargetsTest, CountsPackedAndUnpackedIds) {
  // One scenario: id 1, then -1, then 7 and 8 in a row.
  std::string ids("\x18\x01\x18", 3);
  ids += std::string(9, '\xff') + '\x01';
  ids += std::string("\x1a\x02\x07\x08", 4);
  std::string request("\x12", 1);
  request += static_cast<char>(ids.size());
  request += ids;
  v1::PredictRequest parsed;
  ASSERT_TRUE(parsed.ParseFromString(request));
  ASSERT_EQ(parsed.scenarios(0).target_ids_size(), 4);
  EXPECT_EQ(CountTargets(InSlices(request, 3)), 4u);
}

// Field 3 as eight bytes is not target_ids. One id follows.
TEST(CountTargetsTest, PassesOverAFieldThatTheParserPassesOver) {
  const std::string bytes("\x12\x0b\x19........\x18\x07", 13);
  v1::PredictRequest request;
  ASSERT_TRUE(request.ParseFromString(bytes));
  ASSERT_EQ(request.scenarios(0).target_ids_size(), 1);
  EXPECT_EQ(CountTargets(InSlices(bytes, 3)), 1u);
}

TEST(CountTargetsTest, CountsWhatItFindsInInvalidBytes) {
  const std::string bytes = Request().request().SerializeAsString();
  for (size_t cut = 0; cut < bytes.size(); ++cut) {
    EXPECT_LE(CountTargets(InSlices(bytes.substr(0, cut), 4)), 45u);
  }
  EXPECT_EQ(CountTargets(InSlices("\x12\xff\xff\xff\xff\xff\xff\xff\xff\xff", 3)), 0u);
}

// Returns empty elements of a field: 1 MiB of them.
std::string EmptyElements(int field) {
  std::string elements;
  for (int i = 0; i < 1 << 19; ++i) elements += {static_cast<char>(field << 3 | 2), '\0'};
  return elements;
}

TEST(DensityTest, RefusesALargeRequestOfEmptyElements) {
  v1::PredictRequest states;
  ASSERT_TRUE(states.add_scenarios()->add_agents()->ParseFromString(
      EmptyElements(v1::Agent::kStatesFieldNumber)));
  constexpr int kUnknown = 15;
  for (const std::string& bytes :
       {EmptyElements(v1::PredictRequest::kScenariosFieldNumber), states.SerializeAsString(),
        EmptyElements(v1::PredictRequest::kRequiredActionNamesFieldNumber), EmptyElements(kUnknown),
        "\x7b" + EmptyElements(1) + "\x7c" /* a group of number 15 */}) {
    const absl::Status refused =
        CheckDensity(*v1::PredictRequest::descriptor(), InSlices(bytes, 8192));
    EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  }
}

TEST(DensityTest, AcceptsLargeScenesAndMapsAndLeavesMalformedBytesToTheParser) {
  v1::PredictRequest request;
  for (int scenes = 0; scenes < 400; ++scenes) {
    auto& scene = *request.add_scenarios();
    scene.add_target_ids(1);
    for (int id = 1; id <= 100; ++id) {
      auto& agent = *scene.add_agents();
      agent.set_id(id);
      for (int i = 0; i < 3; ++i) agent.add_states()->set_x(i + 1);
    }
  }
  auto& lane = *request.mutable_scenarios(0)->add_map_features();
  for (int i = 0; i < 200'000; ++i) lane.add_x(i);
  const std::string bytes = request.SerializeAsString();
  ASSERT_GT(bytes.size(), size_t{1} << 20);
  const auto& type = *v1::PredictRequest::descriptor();
  EXPECT_TRUE(CheckDensity(type, InSlices(bytes, 8192)).ok());
  EXPECT_TRUE(CheckDensity(type, InSlices(bytes.substr(0, bytes.size() - 5), 8192)).ok());
  EXPECT_TRUE(CheckDensity(type, InSlices(std::string(2 << 20, '\xff'), 8192)).ok());
  EXPECT_TRUE(CheckDensity(type, InSlices(std::string(1000, '\x12'), 8192)).ok()) << "small";
}

}  // namespace
}  // namespace maneuver::rpc::request_outline_test
