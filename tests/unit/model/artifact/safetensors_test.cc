#include "model/artifact/safetensors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>

namespace maneuver::artifact::safetensors_test {
namespace {

using testing::HasSubstr;

std::string File(std::string_view header, std::string_view data) {
  const uint64_t length = header.size();
  std::string bytes(sizeof(length), '\0');
  std::memcpy(bytes.data(), &length, sizeof(length));
  return bytes.append(header).append(data);
}

const std::string kEightBytes(8, '\0');

TEST(SafetensorsTest, WritesTheWorkedExampleOfTheHeader) {
  const std::string bytes = SerializeSafetensors({{"a", {{1}, {1.0f}}}});
  EXPECT_EQ(bytes, File(R"({"a":{"data_offsets":[0,4],"dtype":"F32","shape":[1]}}  )",
                        std::string_view("\x00\x00\x80\x3f", 4)));
}

TEST(SafetensorsTest, ReadsBackWhatItWrote) {
  const TensorMap tensors = {{"b", {{2, 3}, {1, -2, 3.5f, 0, 1e-30f, -1e30f}}},
                             {"a.weight", {{1}, {7}}},
                             {"none", {{0, 4}, {}}},
                             {"scalar", {{}, {42}}}};
  const auto read = ParseSafetensors(SerializeSafetensors(tensors));
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), tensors.size());
  for (const auto& [name, tensor] : tensors) {
    EXPECT_EQ(read->at(name).shape, tensor.shape) << name;
    EXPECT_EQ(read->at(name).values, tensor.values) << name;
  }
}

TEST(SafetensorsTest, ReadsFilesOfOtherLibraries) {
  // With metadata, another order of keys, and tensors not sorted by name.
  const auto read = ParseSafetensors(File(
      R"({"__metadata__":{"format":"pt"},"z":{"dtype":"F32","shape":[1],"data_offsets":[0,4]},)"
      R"("a":{"dtype":"F32","shape":[1,1],"data_offsets":[4,8]}}   )",
      std::string_view("\x00\x00\x80\x3f\x00\x00\x00\x40", 8)));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->at("z").values, std::vector<float>({1.0f}));
  EXPECT_EQ(read->at("a").values, std::vector<float>({2.0f}));
  EXPECT_EQ(read->size(), 2u);
}

struct Damage {
  const char* name;
  std::string bytes;
  const char* reason;
};

class DamagedSafetensorsTest : public testing::TestWithParam<Damage> {};

TEST_P(DamagedSafetensorsTest, IsRefusedWithTheReason) {
  const auto read = ParseSafetensors(GetParam().bytes);
  EXPECT_EQ(read.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read.status().message()), HasSubstr(GetParam().reason));
}

INSTANTIATE_TEST_SUITE_P(
    All, DamagedSafetensorsTest,
    testing::Values(
        Damage{"Empty", "", "length field"}, Damage{"ShortLength", "\x01", "length field"},
        Damage{"HeaderBeyondTheFile", File("{}", "").substr(0, 9), "truncated"},
        Damage{"HugeHeader", "\xff\xff\xff\xff\xff\xff\xff\xff{}", "header of"},
        Damage{"NotJson", File("{\"a\":", ""), "not a JSON object"},
        Damage{"NotAnObject", File("[]", ""), "not a JSON object"},
        Damage{"EntryNotAnObject", File(R"({"a":3})", ""), "no description"},
        Damage{"OtherType",
               File(R"({"a":{"dtype":"F64","shape":[1],"data_offsets":[0,8]}})", kEightBytes),
               "F32"},
        Damage{"NoShape", File(R"({"a":{"dtype":"F32","data_offsets":[0,8]}})", kEightBytes),
               "no shape"},
        Damage{"NegativeShape",
               File(R"({"a":{"dtype":"F32","shape":[-2],"data_offsets":[0,8]}})", kEightBytes),
               "no shape"},
        Damage{"FractionalShape",
               File(R"({"a":{"dtype":"F32","shape":[2.0],"data_offsets":[0,8]}})", kEightBytes),
               "no shape"},
        Damage{"OneOffset",
               File(R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[0]}})", kEightBytes),
               "no data_offsets"},
        Damage{"ReversedOffsets",
               File(R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[8,0]}})", kEightBytes),
               "outside"},
        Damage{"OffsetsBeyondTheData",
               File(R"({"a":{"dtype":"F32","shape":[3],"data_offsets":[0,12]}})", kEightBytes),
               "outside"},
        Damage{
            "ShapeThatOverflows",
            File(R"({"a":{"dtype":"F32","shape":[4294967296,4294967296,4],"data_offsets":[0,8]}})",
                 kEightBytes),
            "disagree"},
        Damage{"ShapeOfAnotherSize",
               File(R"({"a":{"dtype":"F32","shape":[1],"data_offsets":[0,8]}})", kEightBytes),
               "disagree"},
        Damage{"Overlap",
               File(R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]},)"
                    R"("b":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}})",
                    kEightBytes),
               "overlap"},
        Damage{"Gap",
               File(R"({"a":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}})", kEightBytes),
               "gap"},
        Damage{"TrailingBytes",
               File(R"({"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}})", kEightBytes),
               "after the last"},
        Damage{"NameTwice",
               File(R"({"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]},)"
                    R"("a":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}})",
                    kEightBytes),
               "twice"},
        Damage{"KeyTwice",
               File(R"({"a":{"dtype":"F32","shape":[1],"shape":[2],"data_offsets":[0,8]}})",
                    kEightBytes),
               "twice"}),
    [](const testing::TestParamInfo<Damage>& fault) { return fault.param.name; });

}  // namespace
}  // namespace maneuver::artifact::safetensors_test
