#include "server/rpc/reflection.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/descriptor_database.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::rpc::reflection_test {
namespace {

using grpc::reflection::v1::ServerReflectionRequest;
using grpc::reflection::v1::ServerReflectionResponse;
using ::testing::Contains;
using ::testing::ElementsAre;

std::vector<std::string> FileNames(const ServerReflectionResponse& response) {
  std::vector<std::string> names;
  for (const std::string& bytes : response.file_descriptor_response().file_descriptor_proto()) {
    google::protobuf::FileDescriptorProto file;
    EXPECT_TRUE(file.ParseFromString(bytes));
    names.push_back(file.name());
  }
  return names;
}

TEST(ReflectionTest, ListsTheServicesThatItWasGiven) {
  ServerReflectionRequest request;
  request.set_list_services("");
  request.set_host("here");
  const auto response = AnswerReflection(request, {"a.B", "a.C"});
  std::vector<std::string> names;
  for (const auto& service : response.list_services_response().service()) {
    names.push_back(service.name());
  }
  EXPECT_THAT(names, ElementsAre("a.B", "a.C"));
  EXPECT_EQ(response.valid_host(), "here");
  EXPECT_EQ(response.original_request().SerializeAsString(), request.SerializeAsString());
}

// A tool builds a pool from the files alone: none may be missing, and none come twice.
TEST(ReflectionTest, TheFilesOfASymbolMakeAPoolThatKnowsIt) {
  for (const char* symbol :
       {"maneuver.v1.PredictionService", "maneuver.v1.PredictionService.Predict",
        "maneuver.v1.Scenario", "maneuver.v1.AgentType", "grpc.reflection.v1.ServerReflection"}) {
    ServerReflectionRequest request;
    request.set_file_containing_symbol(symbol);
    const auto response = AnswerReflection(request, {});
    ASSERT_TRUE(response.has_file_descriptor_response()) << symbol;
    google::protobuf::SimpleDescriptorDatabase files;
    for (const std::string& bytes : response.file_descriptor_response().file_descriptor_proto()) {
      google::protobuf::FileDescriptorProto file;
      ASSERT_TRUE(file.ParseFromString(bytes));
      ASSERT_TRUE(files.Add(file)) << "twice: " << file.name();
    }
    google::protobuf::DescriptorPool pool(&files);
    EXPECT_NE(pool.FindFileContainingSymbol(symbol), nullptr) << symbol;
  }
}

TEST(ReflectionTest, AFileOfANameComesFirst) {
  ServerReflectionRequest request;
  request.set_file_by_filename("maneuver/v1/prediction_service.proto");
  const auto names = FileNames(AnswerReflection(request, {}));
  ASSERT_FALSE(names.empty());
  EXPECT_EQ(names.front(), "maneuver/v1/prediction_service.proto");
  EXPECT_THAT(names, Contains("maneuver/v1/scenario.proto"));
}

TEST(ReflectionTest, UnknownNamesAreNotFound) {
  std::vector<ServerReflectionRequest> requests(4);
  requests[0].set_file_by_filename("no/such.proto");
  requests[1].set_file_containing_symbol("maneuver.v1.NoSuch");
  requests[2].mutable_file_containing_extension()->set_containing_type("maneuver.v1.Scenario");
  requests[3].set_all_extension_numbers_of_type("maneuver.v1.NoSuch");
  for (const ServerReflectionRequest& request : requests) {
    EXPECT_EQ(AnswerReflection(request, {}).error_response().error_code(),
              grpc::StatusCode::NOT_FOUND)
        << request.ShortDebugString();
  }
}

TEST(ReflectionTest, AMessageWithoutExtensionsHasNone) {
  ServerReflectionRequest request;
  request.set_all_extension_numbers_of_type("maneuver.v1.Scenario");
  const auto response = AnswerReflection(request, {});
  EXPECT_EQ(response.all_extension_numbers_response().base_type_name(), "maneuver.v1.Scenario");
  EXPECT_EQ(response.all_extension_numbers_response().extension_number_size(), 0);
}

TEST(ReflectionTest, RefusesAnEmptyRequest) {
  EXPECT_EQ(AnswerReflection({}, {}).error_response().error_code(),
            grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace maneuver::rpc::reflection_test
