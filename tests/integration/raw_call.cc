#include "tests/integration/raw_call.h"

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/empty.pb.h>
#include <google/protobuf/unknown_field_set.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <chrono>

#include "maneuver/v1/status.pb.h"

namespace maneuver::integration {
namespace {

// Returns a message with one string or bytes field.
std::string Field(int number, const std::string& value) {
  google::protobuf::Empty message;
  auto* unknown = message.GetReflection()->MutableUnknownFields(&message);
  unknown->AddLengthDelimited(number, value);
  return message.SerializeAsString();
}

// Returns the values of a string, bytes or message field. (The reflection service's own messages
// cannot be compiled in beside gRPC's.)
std::vector<std::string> FieldsOf(const std::string& bytes, int number) {
  google::protobuf::Empty message;
  std::vector<std::string> values;
  if (!message.ParseFromString(bytes)) return values;
  const auto& unknown = message.GetReflection()->GetUnknownFields(message);
  for (int i = 0; i < unknown.field_count(); ++i) {
    const auto& field = unknown.field(i);
    if (field.number() == number &&
        field.type() == google::protobuf::UnknownField::TYPE_LENGTH_DELIMITED) {
      values.push_back(field.length_delimited());
    }
  }
  return values;
}

std::string AskReflection(const std::shared_ptr<grpc::Channel>& channel, const std::string& version,
                          int field, const std::string& value) {
  const RawAnswer answer = Call(
      channel, {.method = "/grpc.reflection." + version + ".ServerReflection/ServerReflectionInfo",
                .request = Field(field, value)});
  EXPECT_TRUE(answer.status.ok()) << answer.status.error_message();
  return answer.messages.empty() ? "" : answer.messages.front();
}

void AddMethods(const std::string& file_bytes, const std::string& service,
                std::vector<std::string>* methods) {
  google::protobuf::FileDescriptorProto file;
  if (!file.ParseFromString(file_bytes)) return;
  for (const auto& described : file.service()) {
    const std::string name = file.package() + "." + described.name();
    if (name != service) continue;
    for (const auto& method : described.method()) {
      methods->push_back("/" + name + "/" + method.name());
    }
  }
}

}  // namespace

RawAnswer Call(const std::shared_ptr<grpc::Channel>& channel, const RawCall& what) {
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  for (const auto& [name, value] : what.headers) context.AddMetadata(name, value);
  const auto finished = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  RawAnswer answer;
  auto call = stub.PrepareCall(&context, what.method, &queue);
  call->StartCall(nullptr);
  finished();
  // A buffer with one empty slice is an empty message; a buffer without slices would be no message.
  const grpc::Slice request(what.request);
  call->WriteLast(grpc::ByteBuffer(&request, 1), grpc::WriteOptions(), nullptr);
  finished();
  for (;;) {
    grpc::ByteBuffer message;
    call->Read(&message, nullptr);
    if (!finished()) break;
    grpc::Slice bytes;
    if (message.DumpToSingleSlice(&bytes).ok()) {
      answer.messages.emplace_back(reinterpret_cast<const char*>(bytes.begin()), bytes.size());
    }
    if (what.stop_after_first) context.TryCancel();
  }
  call->Finish(&answer.status, nullptr);
  finished();
  return answer;
}

std::vector<std::string> MethodsByReflection(const std::shared_ptr<grpc::Channel>& channel,
                                             const std::string& version) {
  constexpr int kListServices = 7;
  constexpr int kListServicesResponse = 6;
  constexpr int kFileContainingSymbol = 4;
  constexpr int kFileDescriptorResponse = 4;
  std::vector<std::string> methods;
  const std::string list = AskReflection(channel, version, kListServices, "");
  for (const std::string& response : FieldsOf(list, kListServicesResponse)) {
    for (const std::string& service : FieldsOf(response, 1)) {
      const std::string name = FieldsOf(service, 1).at(0);
      const size_t before = methods.size();
      const std::string described = AskReflection(channel, version, kFileContainingSymbol, name);
      for (const std::string& files : FieldsOf(described, kFileDescriptorResponse)) {
        for (const std::string& file : FieldsOf(files, 1)) AddMethods(file, name, &methods);
      }
      EXPECT_GT(methods.size(), before) << name;
    }
  }
  return methods;
}

std::string Reason(const grpc::Status& status) {
  v1::Status details;
  if (!details.ParseFromString(status.error_details())) return "";
  for (const auto& any : details.details()) {
    v1::ErrorInfo info;
    if (any.type_url() == "type.googleapis.com/google.rpc.ErrorInfo" &&
        info.ParseFromString(any.value())) {
      return info.reason();
    }
  }
  return "";
}

}  // namespace maneuver::integration
