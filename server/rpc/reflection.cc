#include "server/rpc/reflection.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <set>
#include <utility>

#include "grpc/reflection/v1alpha/reflection.pb.h"
#include "server/rpc/grpc_internals.h"
#include "server/rpc/status_details.h"

namespace maneuver::rpc {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorPool;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::FileDescriptorProto;
using grpc::reflection::v1::FileDescriptorResponse;
using grpc::reflection::v1::ServerReflectionRequest;
using grpc::reflection::v1::ServerReflectionResponse;

// A tool makes one call. An answer has some 100 kB, and stays here until the caller has taken it.
constexpr int kMostCalls = 64;
// Names have at most some hundred bytes. The answer repeats the request.
constexpr size_t kMostRequestBytes = 1 << 10;
constexpr char kReflectionMethod[] = "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo";
constexpr char kAlphaMethod[] = "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo";

void SetError(grpc::StatusCode code, std::string message, ServerReflectionResponse* response) {
  response->mutable_error_response()->set_error_code(code);
  response->mutable_error_response()->set_error_message(std::move(message));
}

// The file, then what it imports, each once.
void AddFile(const FileDescriptor* file, std::set<const FileDescriptor*>* added,
             FileDescriptorResponse* response) {
  if (!added->insert(file).second) return;
  FileDescriptorProto proto;
  file->CopyTo(&proto);
  response->add_file_descriptor_proto(proto.SerializeAsString());
  for (int i = 0; i < file->dependency_count(); ++i) {
    AddFile(file->dependency(i), added, response);
  }
}

void AnswerFile(const FileDescriptor* file, const std::string& name,
                ServerReflectionResponse* response) {
  if (file == nullptr) {
    SetError(grpc::StatusCode::NOT_FOUND, "this server has no " + name, response);
    return;
  }
  std::set<const FileDescriptor*> added;
  AddFile(file, &added, response->mutable_file_descriptor_response());
}

const FileDescriptor* FileOfExtension(const DescriptorPool& pool, const std::string& type,
                                      int number) {
  const Descriptor* const message = pool.FindMessageTypeByName(type);
  const FieldDescriptor* const extension =
      message == nullptr ? nullptr : pool.FindExtensionByNumber(message, number);
  return extension == nullptr ? nullptr : extension->file();
}

void AnswerExtensions(const DescriptorPool& pool, const std::string& type,
                      ServerReflectionResponse* response) {
  const Descriptor* const message = pool.FindMessageTypeByName(type);
  if (message == nullptr) {
    SetError(grpc::StatusCode::NOT_FOUND, "this server has no message " + type, response);
    return;
  }
  std::vector<const FieldDescriptor*> extensions;
  pool.FindAllExtensions(message, &extensions);
  auto* numbers = response->mutable_all_extension_numbers_response();
  numbers->set_base_type_name(type);
  for (const FieldDescriptor* each : extensions) numbers->add_extension_number(each->number());
}

// One call: reads a request, writes its answer, and only then reads the next. Deletes itself.
class ReflectionCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  //   open: is 1 higher until the call ends
  ReflectionCall(const std::vector<std::string>& services, SmallMessages& small,
                 std::atomic<int>& open, grpc::CallbackServerContext* rpc)
      : services_(services), small_(small), open_(open), rpc_(*rpc) {
    if (++open_ > kMostCalls) {
      Finish({grpc::StatusCode::RESOURCE_EXHAUSTED,
              "too many reflection calls are open; try again a little later"});
      return;
    }
    ReadNext();
  }

  void OnReadDone(bool ok) override {
    if (!small_.Remove(number_)) {
      Finish(ToGrpcStatus(NotSmall()));
      return;
    }
    if (!ok) {
      Finish(grpc::Status::OK);
      return;
    }
    // A larger one is not even parsed: what it holds could take much more memory.
    if (message_.Length() > kMostRequestBytes) {
      Finish({grpc::StatusCode::INVALID_ARGUMENT, "a reflection request has at most 1024 bytes"});
      return;
    }
    ServerReflectionRequest request;
    if (!grpc::SerializationTraits<ServerReflectionRequest>::Deserialize(&message_, &request)
             .ok()) {
      Finish(ToGrpcStatus(errors::MalformedMessage()));
      return;
    }
    bool own = false;
    grpc::SerializationTraits<ServerReflectionResponse>::Serialize(
        AnswerReflection(request, services_), &message_, &own);
    StartWrite(&message_);
  }
  void OnWriteDone(bool ok) override {
    if (ok) {
      ReadNext();
    } else {
      Finish(grpc::Status::CANCELLED);
    }
  }
  void OnDone() override {
    --open_;
    delete this;
  }

 private:
  void ReadNext() {
    number_ = small_.Add(rpc_.peer(),
                         [call = std::make_shared<CallHandle>(rpc_)] { call->Cancel(NotSmall()); });
    StartRead(&message_);
  }

  const std::vector<std::string>& services_;
  SmallMessages& small_;
  std::atomic<int>& open_;
  grpc::CallbackServerContext& rpc_;
  int64_t number_ = 0;        // of the request that is read
  grpc::ByteBuffer message_;  // the request that is read, or its answer that is written
};

}  // namespace

ServerReflectionResponse AnswerReflection(const ServerReflectionRequest& request,
                                          const std::vector<std::string>& services) {
  const DescriptorPool& pool = *DescriptorPool::generated_pool();
  ServerReflectionResponse response;
  response.set_valid_host(request.host());
  *response.mutable_original_request() = request;
  switch (request.message_request_case()) {
    case ServerReflectionRequest::kFileByFilename:
      AnswerFile(pool.FindFileByName(request.file_by_filename()), request.file_by_filename(),
                 &response);
      break;
    case ServerReflectionRequest::kFileContainingSymbol:
      AnswerFile(pool.FindFileContainingSymbol(request.file_containing_symbol()),
                 request.file_containing_symbol(), &response);
      break;
    case ServerReflectionRequest::kFileContainingExtension: {
      const auto& extension = request.file_containing_extension();
      AnswerFile(FileOfExtension(pool, extension.containing_type(), extension.extension_number()),
                 "this extension of " + extension.containing_type(), &response);
      break;
    }
    case ServerReflectionRequest::kAllExtensionNumbersOfType:
      AnswerExtensions(pool, request.all_extension_numbers_of_type(), &response);
      break;
    case ServerReflectionRequest::kListServices:
      for (const std::string& name : services) {
        response.mutable_list_services_response()->add_service()->set_name(name);
      }
      break;
    case ServerReflectionRequest::MESSAGE_REQUEST_NOT_SET:
      SetError(grpc::StatusCode::INVALID_ARGUMENT, "message_request: say what to describe",
               &response);
      break;
  }
  return response;
}

ReflectionService::ReflectionService(std::vector<std::string> services, SmallMessages& small)
    : services_(std::move(services)), small_(small) {
  for (const Descriptor* each :
       {ServerReflectionRequest::descriptor(),
        grpc::reflection::v1alpha::ServerReflectionRequest::descriptor()}) {
    services_.push_back(each->file()->service(0)->full_name());
  }
  // gRPC's own v1alpha keeps a thread for each open call.
  AddMethod(new RpcServiceMethod(kAlphaMethod, RpcMethod::BIDI_STREAMING, nullptr));
  MarkMethodCallback(
      1, new BidiHandler<grpc::ByteBuffer, grpc::ByteBuffer>(
             [this](grpc::CallbackServerContext* rpc) { return ServerReflectionInfo(rpc); }));
}

std::vector<std::string> ReflectionService::MethodNames() {
  return {kReflectionMethod, kAlphaMethod};
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>*
ReflectionService::ServerReflectionInfo(grpc::CallbackServerContext* rpc) {
  return new ReflectionCall(services_, small_, calls_, rpc);
}

}  // namespace maneuver::rpc
