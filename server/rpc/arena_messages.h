// Allocates the request and the response of each unary call in an arena each. A scene is tens of
// thousands of small objects; an arena takes them from a few blocks and frees them at once.

#ifndef MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_
#define MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_

#include <google/protobuf/arena.h>
#include <grpcpp/support/message_allocator.h>

#include <memory>

namespace maneuver::rpc {

// Returns the options of an arena for one call. A small request fits into the first block, a scene
// into a few.
inline google::protobuf::ArenaOptions CallArenaOptions() {
  google::protobuf::ArenaOptions options;
  options.start_block_size = size_t{4} << 10;
  options.max_block_size = size_t{64} << 10;
  return options;
}

// The messages of one call.
class CallArena {
 public:
  virtual ~CallArena() = default;
  // Returns an owner of the request: it lives as long as the owner, even if the call frees it.
  virtual std::shared_ptr<const void> Keep() const = 0;
};

// Returns an owner of a call's request; nullptr if the method has no ArenaMessages.
inline std::shared_ptr<const void> KeepRequest(grpc::RpcAllocatorState* state) {
  const auto* arena = dynamic_cast<const CallArena*>(state);
  return arena == nullptr ? nullptr : arena->Keep();
}

// Pass it to SetMessageAllocatorFor_... of the generated services. Must outlive the server.
template <typename Request, typename Response>
class ArenaMessages final : public grpc::MessageAllocator<Request, Response> {
 public:
  grpc::MessageHolder<Request, Response>* AllocateMessages() override { return new Messages; }

 private:
  class Messages final : public grpc::MessageHolder<Request, Response>, public CallArena {
   public:
    Messages() {
      this->set_request(google::protobuf::Arena::CreateMessage<Request>(request_arena_.get()));
      this->set_response(google::protobuf::Arena::CreateMessage<Response>(&response_arena_));
    }
    void Release() override { delete this; }
    void FreeRequest() override {
      this->set_request(nullptr);
      request_arena_ = nullptr;
    }
    std::shared_ptr<const void> Keep() const override { return request_arena_; }

   private:
    std::shared_ptr<google::protobuf::Arena> request_arena_ =
        std::make_shared<google::protobuf::Arena>(CallArenaOptions());
    google::protobuf::Arena response_arena_{CallArenaOptions()};
  };
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_
