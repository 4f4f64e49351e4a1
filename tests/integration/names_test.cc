// Checks that no name leads out of the data folder. Finds every name in every request of the
// contract by walking the descriptors, and sets it to what an attacker would write. The requests of
// AdminService and ReplicaService have no strings so far.

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "maneuver/v1/outcome_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/status.pb.h"
#include "tests/integration/all_methods.h"
#include "tests/integration/raw_call.h"
#include "tests/integration/secured_server.h"

namespace maneuver::integration::names_test {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::MethodDescriptor;

// Fields that name something on the server's disk, and tokens that are made of such names.
const std::set<std::string> kNames = {"name",       "parent",        "model", "model_version",
                                      "dataset",    "datasets",      "file",  "page_token",
                                      "start_from", "test_datasets", "tags"};
// Strings that name nothing: the server keeps them or compares them.
// `folder` is a path that only --dataset-folders can allow: registration_test.
const std::set<std::string> kOtherStrings = {
    "folder", "request_id", "scenario_id",          "label", "origin", "sha256", "preset", "device",
    "metric", "rival",      "required_action_names"};

const std::vector<std::string> kHostile = {
    "../../etc/passwd",
    "/etc/passwd",
    "file:///etc/passwd",
    "http://127.0.0.1/x",
    "//host/share",
    "..",
    ".",
    "~root",
    "models/..",
    "models/../../x",
    "models/a/../../b",
    "models/.hidden",
    "models/a/versions/../../b",
    "models/a/versions/1/../2",
    "models/a/versions/1/",
    "models/a@../b",
    "models/%2e%2e%2fx",
    "models/..%2fx",
    "models/..%c0%afx",
    "models/http://x",
    "models\\..\\x",
    std::string("models/a\0/versions/1", 20),
    "models/a\n",
    "models/\xef\xbd\x81",             // a full-width letter
    "models/\xe2\x80\xae/versions/1",  // right-to-left override
    "models/a/aliases/../b",
    "datasets/..",
    "datasets/../models",
    "datasets/a/../../b",
    "datasets//etc",
    "datasets/http://x",
    std::string("datasets/a\0b", 12),
    "datasets/" + std::string(100'000, 'a'),
    "tags/..",
    "tags/a/../../datasets",
    "jobs/..",
    "jobs/../x",
    "jobs/a/b",
    "jobs/-rf",
    "shards/../../x",
    "shard-00000.tfrecord/../../x",
};

// Valid values for the other names of a request, so that only the tested name is invalid.
const std::map<std::string, std::string> kHarmless = {
    {"maneuver.v1.SetModelAliasRequest.name", "models/a/aliases/b"},
    {"maneuver.v1.SetModelAliasRequest.model_version", "models/a/versions/1"},
    {"maneuver.v1.TrainRequest.model", "models/a"},
    {"maneuver.v1.TrainRequest.datasets", "datasets/a"},
    {"maneuver.v1.CrossValidateRequest.datasets", "datasets/a"},
    {"maneuver.v1.RecalibrateRequest.model", "models/a/versions/1"},
    {"maneuver.v1.RecalibrateRequest.datasets", "datasets/a"},
    {"maneuver.v1.EvaluateRequest.model", "models/a/versions/1"},
    {"maneuver.v1.TagRequest.model", "models/a/versions/1"},
    {"maneuver.v1.TagRequest.datasets", "datasets/a"},
    {"maneuver.v1.TagRequest.tags", "tags/a"},
    {"maneuver.v1.EvaluateRequest.dataset", "datasets/a"},
    {"maneuver.v1.ListModelVersionsRequest.parent", "models/a"},
    {"maneuver.v1.ListEvaluationReportsRequest.parent", "models/a/versions/1"},
    {"maneuver.v1.ListScenariosRequest.parent", "datasets/a"},
    {"maneuver.v1.UploadHeader.name", "datasets/a"},
    {"maneuver.v1.QueryUploadRequest.name", "datasets/a"},
    {"maneuver.v1.UploadModelHeader.parent", "models/a"},
    {"maneuver.v1.QueryModelUploadRequest.parent", "models/a"},
    {"maneuver.v1.Dataset.name", ""},  // the server's to say; UploadHeader.name counts
};

// The path from a request to one of its strings.
using Path = std::vector<const FieldDescriptor*>;

void CollectStrings(const google::protobuf::Descriptor& type, const Path& so_far,
                    std::vector<Path>* paths) {
  if (type.full_name() == "maneuver.v1.Scenario") return;  // content, without names
  for (int i = 0; i < type.field_count(); ++i) {
    const FieldDescriptor* field = type.field(i);
    Path path = so_far;
    path.push_back(field);
    if (field->type() == FieldDescriptor::TYPE_STRING) paths->push_back(path);
    if (field->type() == FieldDescriptor::TYPE_MESSAGE && path.size() < 5) {
      CollectStrings(*field->message_type(), path, paths);
    }
  }
}

void SetString(Message* message, const FieldDescriptor* field, const std::string& value) {
  const auto* reflection = message->GetReflection();
  if (field->is_repeated()) {
    reflection->ClearField(message, field);
    reflection->AddString(message, field, value);
  } else {
    reflection->SetString(message, field, value);
  }
}

// An outcome whose model is looked at.
void FillOutcome(v1::Outcome* outcome) {
  outcome->mutable_scenario();
  if (outcome->targets().empty()) outcome->add_targets();
}

void FillHarmless(Message* message) {
  using google::protobuf::DynamicCastToGenerated;
  if (auto* report = DynamicCastToGenerated<v1::ReportOutcomesRequest>(message)) {
    FillOutcome(report->add_outcomes());
  }
  const auto& type = *message->GetDescriptor();
  for (int i = 0; i < type.field_count(); ++i) {
    const auto known = kHarmless.find(type.field(i)->full_name());
    if (known != kHarmless.end()) SetString(message, type.field(i), known->second);
  }
}

// Returns the request's bytes with `value` at the path and harmless names beside it, and the path
// in words.
std::string RequestWith(const google::protobuf::Descriptor& type, const Path& path,
                        const std::string& value, std::string* words) {
  const std::unique_ptr<Message> request(
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(&type)->New());
  Message* message = request.get();
  words->clear();
  FillHarmless(message);
  for (const FieldDescriptor* field : path) {
    *words += (words->empty() ? "" : ".") + field->name();
    if (field->is_repeated()) *words += "[0]";
    if (field == path.back()) {
      SetString(message, field, value);
    } else {
      const auto* reflection = message->GetReflection();
      if (!field->is_repeated()) {
        message = reflection->MutableMessage(message, field);
      } else if (reflection->FieldSize(*message, field) > 0) {
        message = reflection->MutableRepeatedMessage(message, field, 0);
      } else {
        message = reflection->AddMessage(message, field);
      }
      FillHarmless(message);
    }
  }
  return request->SerializeAsString();
}

// Returns the error of the first outcome.
v1::Status ErrorOf(const v1::ReportOutcomesResponse& response) {
  return response.scores().empty() ? v1::Status() : response.scores(0).error();
}

// Returns the error that a request was answered with. On a stream, the answer to one request is a
// message. Each outcome of a report fails alone.
v1::Status ErrorOf(const MethodDescriptor& method, const RawAnswer& answer) {
  v1::Status error;
  if (!answer.status.ok()) {
    error.ParseFromString(answer.status.error_details());
    error.set_code(answer.status.error_code());
    return error;
  }
  if (answer.messages.empty()) return error;
  const std::string& message = answer.messages.front();
  const std::string& type = method.output_type()->name();
  if (type == "StreamPredictResponse") {
    v1::StreamPredictResponse response;
    if (response.ParseFromString(message)) error = response.error();
  } else if (type == "ReportOutcomesResponse") {
    v1::ReportOutcomesResponse response;
    if (response.ParseFromString(message)) error = ErrorOf(response);
  } else if (type == "StreamOutcomesResponse") {
    v1::StreamOutcomesResponse response;
    if (response.ParseFromString(message)) {
      error = response.has_error() ? response.error() : ErrorOf(response.response());
    }
  }
  return error;
}

std::vector<std::string> Violations(const v1::Status& error) {
  std::vector<std::string> fields;
  for (const auto& any : error.details()) {
    v1::BadRequest detail;
    if (any.type_url() != "type.googleapis.com/google.rpc.BadRequest") continue;
    detail.ParseFromString(any.value());
    for (const auto& violation : detail.field_violations()) fields.push_back(violation.field());
  }
  return fields;
}

std::set<std::string> FilesBelow(const std::filesystem::path& folder) {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    files.insert(entry.path().string());
  }
  return files;
}

TEST(NamesTest, NoNameInARequestReachesOutsideTheDataFolder) {
  SecuredFolder folder;
  const auto server = folder.Start();
  const auto channel = Connect(*server, "");
  const std::set<std::string> before = FilesBelow(folder.path());
  int names = 0;
  for (const MethodDescriptor* method : AllMethods()) {
    std::vector<Path> paths;
    CollectStrings(*method->input_type(), {}, &paths);
    for (const Path& path : paths) {
      const std::string& field = path.back()->name();
      if (kOtherStrings.contains(field)) continue;
      SCOPED_TRACE(method->full_name() + " by " + path.back()->full_name());
      ASSERT_TRUE(kNames.contains(field)) << "a new string: is it a name?";
      if (path.back()->full_name() == "maneuver.v1.Dataset.name") continue;
      ++names;
      for (const std::string& hostile : kHostile) {
        RawCall call{.method = "/" + method->service()->full_name() + "/" + method->name(),
                     .request = ""};
        std::string words;
        call.request = RequestWith(*method->input_type(), path, hostile, &words);
        const v1::Status error = ErrorOf(*method, Call(channel, call));
        ASSERT_EQ(error.code(), static_cast<int>(grpc::StatusCode::INVALID_ARGUMENT))
            << words << ": " << hostile.substr(0, 100) << ": " << error.message();
        // A violation names this field or the message that contains it.
        const auto violations = Violations(error);
        EXPECT_TRUE(std::ranges::any_of(violations,
                                        [&](const std::string& v) {
                                          return words.find(v) != std::string::npos ||
                                                 v.find(field) != std::string::npos;
                                        }))
            << words << ": " << ::testing::PrintToString(violations);
        EXPECT_EQ(error.message().find("etc"), std::string::npos) << "names are not echoed";
      }
    }
  }
  EXPECT_GE(names, 60);
  EXPECT_TRUE(server->Alive());
  EXPECT_EQ(FilesBelow(folder.path()), before);
}

}  // namespace
}  // namespace maneuver::integration::names_test
