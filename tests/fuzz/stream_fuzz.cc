// The messages of one StreamPredict, in process: gRPC's side of the call is here, the stream and all
// behind it are the server's. Each message gets one answer, which belongs to it; each error has a
// reason; the stream ends once, when it should, and with the right status.

#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/status.pb.h"
#include "server/monitoring/metrics.h"
#include "server/rpc/open_streams.h"
#include "server/rpc/predict_stream.h"
#include "server/rpc/prediction_run.h"
#include "server/rpc/request_outline.h"
#include "stream_script.pb.h"
#include "tests/fuzz/harness.h"
#include "tests/unit/server/serving/fake_action_model.h"
#include "tests/unit/server/serving/memory_alias_store.h"

namespace maneuver::fuzz {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr int kMostSteps = 100;
constexpr size_t kMostId = 128;  // characters
// Nothing here takes a second.
constexpr auto kStuck = std::chrono::seconds(60);

grpc::ByteBuffer BufferOf(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return {&slice, 1};
}

// A server without the network, with a model that costs nothing. Lives as long as the process.
struct Service {
  Service() {
    const std::filesystem::path folder = Folder() / "streamed";
    std::filesystem::create_directories(folder / "finished");
    std::ofstream(folder / "finished" / "weights.safetensors") << "x";
    versions = *serving::VersionStore::Open(folder / "models");
    models = *serving::ServingTable::Open(
        *versions, aliases,
        [this](const std::filesystem::path&)
            -> absl::StatusOr<std::shared_ptr<const inference::ActionModel>> {
          return std::make_shared<serving::FakeActionModel>(networks);
        },
        {.max_unaliased_in_memory = 0}, metrics);
    const auto published = models->Publish("town", folder / "finished", v1::PROMOTION_UNSPECIFIED);
    Expect(published.ok(), published.status().ToString());
    context.emplace(rpc::PredictionContext{
        *models, scheduler, maps, send_memory, disk, disk, {.map_by_id = true}, *access});
  }

  monitoring::MetricRegistry& metrics = monitoring::MetricRegistry::Null();
  const std::unique_ptr<security::AccessControl> access =
      *security::AccessControl::Create({}, metrics);
  serving::FakeNetworks networks;
  serving::MemoryAliasStore aliases;
  std::unique_ptr<serving::VersionStore> versions;
  std::unique_ptr<serving::ServingTable> models;
  serving::SendMemory send_memory{{.max_response_bytes = 1 << 20, .max_send_memory = 4 << 20},
                                  metrics};
  serving::BatchScheduler scheduler{{.workers = 2, .queue = {.max_queue = 50}}, metrics};
  serving::MapCache maps{{.max_maps = 2}, metrics};
  rpc::WorkerPool disk{1, 10};
  std::optional<rpc::PredictionContext> context;  // set once the models are there
};

Service& TheService() {
  static Service& service = *new Service;
  return service;
}

void ExpectError(const v1::Status& error) {
  const std::string said = error.ShortDebugString();
  Expect(error.code() >= 1 && error.code() <= 16 && error.code() != grpc::StatusCode::UNKNOWN &&
             error.code() != grpc::StatusCode::INTERNAL,
         said);
  Expect(!error.message().empty(), said);
  v1::ErrorInfo info;
  bool place = error.code() != grpc::StatusCode::INVALID_ARGUMENT;
  for (const auto& detail : error.details()) {
    v1::BadRequest request;
    if (detail.type_url() == "type.googleapis.com/google.rpc.ErrorInfo") {
      Expect(info.ParseFromString(detail.value()), said);
    } else if (detail.type_url() == "type.googleapis.com/google.rpc.BadRequest") {
      Expect(request.ParseFromString(detail.value()), said);
      place = place ||
              (request.field_violations_size() > 0 && !request.field_violations(0).field().empty());
    }
  }
  // Those come from the caller's own deadline and cancellation.
  const bool own = error.code() == grpc::StatusCode::DEADLINE_EXCEEDED ||
                   error.code() == grpc::StatusCode::CANCELLED;
  Expect(own || !info.reason().empty(), absl::StrCat("an error has a reason: ", said));
  // Of a message that does not parse, no field can be named.
  Expect(place || info.reason() == "MALFORMED_MESSAGE",
         absl::StrCat("a refusal names a field: ", said));
}

// Checks every number of a message, and every error in it.
void ExpectWellFormed(const Message& message) {
  if (message.GetDescriptor() == v1::Status::descriptor()) {
    v1::Status error;
    error.CopyFrom(message);
    return ExpectError(error);
  }
  const auto* const reflection = message.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection->ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const bool repeated = field->is_repeated();
    const int count = repeated ? reflection->FieldSize(message, field) : 1;
    for (int i = 0; i < count; ++i) {
      if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
        ExpectWellFormed(repeated ? reflection->GetRepeatedMessage(message, field, i)
                                  : reflection->GetMessage(message, field));
      } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE) {
        Expect(std::isfinite(repeated ? reflection->GetRepeatedDouble(message, field, i)
                                      : reflection->GetDouble(message, field)),
               field->full_name());
      }
    }
  }
}

// gRPC's side of a call, and the caller behind it. The stream calls it from any thread; the rest is
// called by the harness.
class Call final : public grpc::ServerCallbackReaderWriter<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  explicit Call(Service& service)
      : stream_(rpc::PredictStream::Open(*service.context, streams_, &context_)) {
    BindReactor(stream_);
  }

  // Whatever the script left open: the caller takes all answers and sends no more.
  void Complete() {
    while (!Finished()) {
      if (Takes(true)) continue;
      if (Waits() && Ends()) continue;
      std::unique_lock lock(mutex_);
      const bool moved = changed_.wait_for(lock, kStuck, [&] {
        return status_.has_value() || written_ != nullptr || (read_ != nullptr && Waits());
      });
      Expect(moved, "a stream goes on until it has ended");
    }
    if (ReadFails()) stream_->OnReadDone(false);
    Expect(written_ == nullptr, "a stream ends when its last answer was taken");
    const auto code = status_->error_code();
    if (code == grpc::StatusCode::OK) {
      Expect(ended_ || cancelled_, "a stream ends when its caller sends no more");
      Expect(cancelled_ || AllAnswered(), "each message is answered");
    } else if (code == grpc::StatusCode::UNAVAILABLE) {
      Expect(drained_ && AllAnswered(),
             "a stopping server answers every message that it has received");
    } else {
      Expect(code == grpc::StatusCode::CANCELLED && cancelled_, status_->error_message());
    }
    stream_->OnDone();
  }

  void Sends(const std::string& bytes) {
    grpc::ByteBuffer* place = nullptr;
    {
      const std::lock_guard lock(mutex_);
      if (read_ == nullptr || status_) return;  // flow control makes the caller wait
      place = std::exchange(read_, nullptr);
      const auto outline = rpc::ReadStreamOutline(BufferOf(bytes));
      v1::StreamPredictRequest request;
      const bool parses = request.ParseFromString(bytes);
      Asked& asked =
          asked_[outline && outline->request_id.size() <= kMostId ? outline->request_id : ""];
      ++asked.unanswered;
      if (parses) asked.scenarios.insert(request.request().scenarios_size());
    }
    *place = BufferOf(bytes);
    stream_->OnReadDone(true);
  }

  // Returns whether there was an answer.
  bool Takes(bool arrives) {
    {
      const std::lock_guard lock(mutex_);
      if (written_ == nullptr) return false;
      if (arrives) Receive(*written_);
      written_ = nullptr;
    }
    stream_->OnWriteDone(arrives);
    return true;
  }

  // Returns whether the stream learned of it.
  bool Ends() {
    if (!ReadFails()) return false;
    ended_ = true;
    stream_->OnReadDone(false);
    return true;
  }

  void Cancels() {
    if (cancelled_ || Finished()) return;
    cancelled_ = true;
    stream_->OnCancel();
    Ends();
    Takes(false);
  }

  void Drains() {
    drained_ = true;
    streams_.Drain();
  }

  void Read(grpc::ByteBuffer* message) override {
    const std::lock_guard lock(mutex_);
    Expect(read_ == nullptr && !status_, "one read at a time");
    read_ = message;
    changed_.notify_all();
  }
  void Write(const grpc::ByteBuffer* message, grpc::WriteOptions) override {
    const std::lock_guard lock(mutex_);
    Expect(written_ == nullptr && !status_, "one write at a time, and none after the end");
    written_ = message;
    changed_.notify_all();
  }
  void Finish(grpc::Status status) override {
    const std::lock_guard lock(mutex_);
    Expect(!status_, "a stream ends once");
    status_ = std::move(status);
    changed_.notify_all();
  }
  void SendInitialMetadata() override {}
  void WriteAndFinish(const grpc::ByteBuffer*, grpc::WriteOptions, grpc::Status) override {
    Expect(false, "answers and the end are apart");
  }

 private:
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* reactor() override {
    return stream_;
  }
  void CallOnDone() override {}

  bool Finished() {
    const std::lock_guard lock(mutex_);
    return status_.has_value();
  }
  // Takes away a read that waits for a message.
  bool ReadFails() {
    const std::lock_guard lock(mutex_);
    return std::exchange(read_, nullptr) != nullptr;
  }

  void Receive(const grpc::ByteBuffer& bytes) {
    grpc::Slice whole;
    v1::StreamPredictResponse answer;
    Expect(bytes.DumpToSingleSlice(&whole).ok() &&
               answer.ParseFromArray(whole.begin(), static_cast<int>(whole.size())),
           "an answer can be parsed");
    Expect(answer.has_response() || answer.has_error(), "an answer says something");
    ExpectWellFormed(answer);
    Asked& asked = asked_[answer.request_id()];
    Expect(--asked.unanswered >= 0,
           absl::StrCat("an answer belongs to a message: ", answer.ShortDebugString()));
    if (!answer.has_response()) return;
    const auto scenarios = asked.scenarios.find(answer.response().predictions_size());
    Expect(scenarios != asked.scenarios.end(), "each scenario of a message has an item");
    asked.scenarios.erase(scenarios);
  }

  bool AllAnswered() const {
    return std::all_of(asked_.begin(), asked_.end(),
                       [](const auto& each) { return each.second.unanswered == 0; });
  }
  // A stream that the server ends does not wait for its caller.
  bool Waits() const { return !ended_ && !drained_; }

  // The messages of one id.
  struct Asked {
    int unanswered = 0;
    std::multiset<int> scenarios;  // in each message that parses
  };

  rpc::OpenStreams streams_;
  grpc::CallbackServerContext context_;
  rpc::PredictStream* const stream_;
  // Used by the harness alone.
  bool ended_ = false;
  bool cancelled_ = false;
  bool drained_ = false;

  std::mutex mutex_;  // guards what follows
  std::condition_variable changed_;
  grpc::ByteBuffer* read_ = nullptr;           // where the stream waits for a message
  const grpc::ByteBuffer* written_ = nullptr;  // what the caller has not taken
  std::optional<grpc::Status> status_;
  std::map<std::string, Asked> asked_;
};

}  // namespace

void Stream(std::string_view bytes) {
  StreamScript script;
  if (!ParseMessage(bytes, &script)) return;
  Service& service = TheService();
  Call call(service);
  for (int i = 0; i < std::min(script.steps_size(), kMostSteps); ++i) {
    const StreamStep& step = script.steps(i);
    if (step.has_request()) {
      call.Sends(step.request().SerializePartialAsString());
    } else if (step.step_case() == StreamStep::kRaw) {
      call.Sends(step.raw());
    } else if (step.event() == STREAM_EVENT_TAKES) {
      call.Takes(true);
    } else if (step.event() == STREAM_EVENT_ENDS) {
      call.Ends();
    } else if (step.event() == STREAM_EVENT_CANCELS) {
      call.Cancels();
    } else if (step.event() == STREAM_EVENT_DRAINS) {
      call.Drains();
    } else if (step.event() == STREAM_EVENT_HOLDS) {
      service.networks.CloseGate();
    } else if (step.event() == STREAM_EVENT_RELEASES) {
      service.networks.OpenGate();
    }
  }
  service.networks.OpenGate();
  call.Complete();
}

}  // namespace maneuver::fuzz
