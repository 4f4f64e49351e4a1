// Checks that everything in the contract exists: calls each method of each service over the wire,
// with an empty request, on an empty server.

#include <google/protobuf/descriptor.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "tests/integration/all_methods.h"
#include "tests/integration/server_process.h"

namespace maneuver::integration::every_method_test {
namespace {

using google::protobuf::MethodDescriptor;

// Calls /service/method with one empty message, and reads the whole answer.
grpc::Status Call(const std::shared_ptr<grpc::Channel>& channel, const std::string& method) {
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
  const auto finished = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  auto call = stub.PrepareCall(&context, method, &queue);
  call->StartCall(nullptr);
  finished();
  // A buffer with one empty slice is an empty message; a buffer without slices would be no message.
  const grpc::Slice empty;
  call->WriteLast(grpc::ByteBuffer(&empty, 1), grpc::WriteOptions(), nullptr);
  finished();
  grpc::ByteBuffer answer;
  do {
    call->Read(&answer, nullptr);
  } while (finished());
  grpc::Status status;
  call->Finish(&status, nullptr);
  finished();
  return status;
}

TEST(EveryMethodTest, AnswersAnEmptyRequest) {
  TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "data");
  ServerProcess server(folder.path() / "data");
  const std::vector<const MethodDescriptor*> methods = AllMethods();
  EXPECT_EQ(methods.size(), 48u);
  for (const MethodDescriptor* method : methods) {
    const std::string path = "/" + method->service()->full_name() + "/" + method->name();
    SCOPED_TRACE(path);
    const grpc::Status status = Call(server.channel(), path);
    EXPECT_NE(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
    EXPECT_NE(status.error_code(), grpc::StatusCode::INTERNAL) << status.error_message();
    EXPECT_NE(status.error_code(), grpc::StatusCode::UNKNOWN) << status.error_message();
    EXPECT_NE(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
    EXPECT_TRUE(server.Alive());
  }
}

}  // namespace
}  // namespace maneuver::integration::every_method_test
