// Fuzz harnesses: functions that take any bytes and check what must hold whatever they are.
//
// A harness is one file. It works under libFuzzer (fuzzer.cc, built by clang), and in ctest with
// the corpus and a bounded number of seeded mutations (replay.cc).

#ifndef MANEUVER_TESTS_FUZZ_HARNESS_H_
#define MANEUVER_TESTS_FUZZ_HARNESS_H_

#include <google/protobuf/message.h>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace maneuver::fuzz {

struct Harness {
  const char* name;
  // Aborts, by Expect or by a sanitizer, if an invariant does not hold.
  void (*run)(std::string_view bytes);
  // The message that the bytes are, for mutations of its fields; nullptr for bytes of another form.
  const google::protobuf::Message* (*message)();
};

// All harnesses, by name.
const std::vector<Harness>& Harnesses();
// Returns nullptr if there is none of this name.
const Harness* FindHarness(std::string_view name);

// Prints `what` and aborts unless `holds`.
void Expect(bool holds, std::string_view what);

// Returns a folder of this process, in memory where the machine has such a file system. It is
// removed when the process ends normally.
const std::filesystem::path& Folder();
// Writes `bytes` to a file in Folder() and returns its path. Reuses the file.
std::filesystem::path FileOf(std::string_view bytes);

// Returns the content of a file; empty if it cannot be read.
std::string ReadBytes(const std::filesystem::path& file);

// Parses proto3 or proto2 bytes; false if they are not such a message.
bool ParseMessage(std::string_view bytes, google::protobuf::Message* message);

void Argoverse(std::string_view bytes);
void Configuration(std::string_view bytes);
void CommonRoad(std::string_view bytes);
void DatasetJson(std::string_view bytes);
void Labels(std::string_view bytes);
void LanePaths(std::string_view bytes);
void ModelJson(std::string_view bytes);
void Names(std::string_view bytes);
void NuScenes(std::string_view bytes);
void Outline(std::string_view bytes);
void Safetensors(std::string_view bytes);
void Scenario(std::string_view bytes);
void Settings(std::string_view bytes);
void ShardIndex(std::string_view bytes);
void Stream(std::string_view bytes);
void Tags(std::string_view bytes);
void TfRecord(std::string_view bytes);
void Tokens(std::string_view bytes);
void Upload(std::string_view bytes);
void Waymo(std::string_view bytes);

}  // namespace maneuver::fuzz

#endif  // MANEUVER_TESTS_FUZZ_HARNESS_H_
