// Runs harnesses without libFuzzer: replay HARNESS MUTATIONS FILE_OR_FOLDER...
//
// Runs each file, then MUTATIONS mutations of them, always the same. What breaks is left in a file
// "broken-HARNESS", whose path is printed first.

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tests/fuzz/harness.h"
#include "tests/fuzz/mutation.h"

namespace maneuver::fuzz {
namespace {

std::vector<std::string> ReadInputs(const std::vector<std::filesystem::path>& paths) {
  std::vector<std::filesystem::path> files;
  for (const auto& path : paths) {
    if (!std::filesystem::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    for (const auto& entry : std::filesystem::directory_iterator(path))
      files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::vector<std::string> inputs;
  for (const auto& file : files) inputs.push_back(ReadBytes(file));
  return inputs;
}

std::string Mutated(const Harness& harness, const std::vector<std::string>& inputs,
                    Random& random) {
  std::string bytes = inputs[random.Below(inputs.size())];
  const google::protobuf::Message* const type = harness.message();
  const bool fields = type != nullptr && !random.OneIn(8);
  const uint64_t changes = 1 + random.Below(5);
  if (!fields) {
    for (uint64_t i = 0; i < changes; ++i) MutateBytes(random, &bytes);
    return bytes;
  }
  const std::unique_ptr<google::protobuf::Message> message(type->New());
  ParseMessage(bytes, message.get());
  for (uint64_t i = 0; i < changes; ++i) MutateMessage(random, message.get());
  return message->SerializePartialAsString();
}

std::string* current = nullptr;
std::string* broken_file = nullptr;

// Only calls what may be called in a handler, but for the stream: the process ends here anyway.
void KeepInput(int signal) {
  std::fprintf(stderr, "the input is in %s\n", broken_file->c_str());
  std::ofstream(*broken_file, std::ios::binary) << *current;
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

int Replay(const Harness& harness, uint64_t mutations,
           const std::vector<std::filesystem::path>& paths) {
  const std::vector<std::string> inputs = ReadInputs(paths);
  if (inputs.empty()) {
    std::fprintf(stderr, "replay: no inputs\n");
    return 2;
  }
  std::string bytes;
  std::string file = std::string("broken-") + harness.name;
  current = &bytes;
  broken_file = &file;
  for (const int signal : {SIGABRT, SIGSEGV, SIGFPE, SIGILL, SIGBUS})
    std::signal(signal, KeepInput);
  for (const std::string& input : inputs) harness.run(bytes = input);
  Random random(1);
  for (uint64_t i = 0; i < mutations; ++i) harness.run(bytes = Mutated(harness, inputs, random));
  std::printf("%s: %zu inputs and %llu mutations\n", harness.name, inputs.size(),
              static_cast<unsigned long long>(mutations));
  return 0;
}

}  // namespace
}  // namespace maneuver::fuzz

int main(int argc, char** argv) {
  const auto* harness = argc > 3 ? maneuver::fuzz::FindHarness(argv[1]) : nullptr;
  if (harness == nullptr) {
    std::fprintf(stderr, "replay HARNESS MUTATIONS FILE_OR_FOLDER...\n");
    return 2;
  }
  return maneuver::fuzz::Replay(*harness, std::strtoull(argv[2], nullptr, 10),
                                {argv + 3, argv + argc});
}
