// Requests and responses of unary calls in an arena each: a scene is tens of thousands of small
// objects, which are then taken from a few blocks and given back at once.

#ifndef MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_
#define MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_

#include <google/protobuf/arena.h>
#include <grpcpp/support/message_allocator.h>

namespace maneuver::rpc {

// For SetMessageAllocatorFor_... of the generated services; outlives the server.
template <typename Request, typename Response>
class ArenaMessages final : public grpc::MessageAllocator<Request, Response> {
 public:
  grpc::MessageHolder<Request, Response>* AllocateMessages() override { return new Messages; }

 private:
  class Messages final : public grpc::MessageHolder<Request, Response> {
   public:
    Messages() : arena_(Options()) {
      this->set_request(google::protobuf::Arena::CreateMessage<Request>(&arena_));
      this->set_response(google::protobuf::Arena::CreateMessage<Response>(&arena_));
    }
    void Release() override { delete this; }

   private:
    // A small request fits into the first block, a scene into a few.
    static google::protobuf::ArenaOptions Options() {
      google::protobuf::ArenaOptions options;
      options.start_block_size = size_t{4} << 10;
      options.max_block_size = size_t{64} << 10;
      return options;
    }

    google::protobuf::Arena arena_;
  };
};

}  // namespace maneuver::rpc

#endif  // MANEUVER_SERVER_RPC_ARENA_MESSAGES_H_
