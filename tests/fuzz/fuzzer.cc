// The harnesses under libFuzzer: fuzzer --harness=NAME [libFuzzer's options] [FOLDER...]

#include <google/protobuf/message.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>

#include "tests/fuzz/harness.h"
#include "tests/fuzz/mutation.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace {

const maneuver::fuzz::Harness* harness = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  constexpr std::string_view kOption = "--harness=";
  for (int i = 1; i < *argc; ++i) {
    const std::string_view argument = (*argv)[i];
    if (argument.substr(0, kOption.size()) == kOption) {
      harness = maneuver::fuzz::FindHarness(argument.substr(kOption.size()));
    }
  }
  if (harness != nullptr) return 0;
  std::fprintf(stderr, "fuzzer: --harness=NAME, one of");
  for (const auto& each : maneuver::fuzz::Harnesses()) std::fprintf(stderr, " %s", each.name);
  std::fprintf(stderr, "\n");
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  harness->run({reinterpret_cast<const char*>(data), size});
  return 0;
}

// Fields of a message are mutated as such: few bytes that libFuzzer changes leave a message.
extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned int seed) {
  using maneuver::fuzz::Random;
  Random random(seed);
  const google::protobuf::Message* const type = harness->message();
  if (type == nullptr || random.OneIn(8)) return LLVMFuzzerMutate(data, size, max_size);
  const std::unique_ptr<google::protobuf::Message> message(type->New());
  maneuver::fuzz::ParseMessage({reinterpret_cast<const char*>(data), size}, message.get());
  for (uint64_t left = 1 + random.Below(4); left > 0; --left) {
    maneuver::fuzz::MutateMessage(random, message.get());
  }
  const std::string bytes = message->SerializePartialAsString();
  if (bytes.size() > max_size) return LLVMFuzzerMutate(data, size, max_size);
  std::memcpy(data, bytes.data(), bytes.size());
  return bytes.size();
}
