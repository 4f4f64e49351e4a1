#include "model/data/crc32c.h"

#include <gtest/gtest.h>

#include <string>

namespace maneuver::data {
namespace {

// RFC 3720, appendix B.4, and the check value of the CRC catalogue.
TEST(Crc32cTest, AgreesWithPublishedVectors) {
  std::string rising;
  for (int i = 0; i < 32; ++i) rising.push_back(static_cast<char>(i));
  for (const auto extend : {&ExtendCrc32c, &ExtendCrc32cByTable}) {
    EXPECT_EQ(extend(0, ""), 0u);
    EXPECT_EQ(extend(0, "123456789"), 0xE3069283u);
    EXPECT_EQ(extend(0, std::string(32, '\0')), 0x8A9136AAu);
    EXPECT_EQ(extend(0, std::string(32, '\xFF')), 0x62A8AB43u);
    EXPECT_EQ(extend(0, rising), 0x46DD794Eu);
  }
}

TEST(Crc32cTest, InstructionAndTableAgreeAtEveryLengthAndAlignment) {
  std::string bytes;
  for (int i = 0; i < 100; ++i) bytes.push_back(static_cast<char>(i * i + 7 * i));
  for (size_t start = 0; start < 9; ++start) {
    for (size_t size = 0; start + size <= bytes.size(); ++size) {
      const std::string_view part = std::string_view(bytes).substr(start, size);
      ASSERT_EQ(ExtendCrc32c(0, part), ExtendCrc32cByTable(0, part)) << start << " " << size;
    }
  }
}

TEST(Crc32cTest, ExtendingByPiecesGivesTheChecksumOfTheWhole) {
  const std::string_view bytes = "123456789";
  for (size_t cut = 0; cut <= bytes.size(); ++cut) {
    EXPECT_EQ(ExtendCrc32c(Crc32c(bytes.substr(0, cut)), bytes.substr(cut)), 0xE3069283u);
  }
}

}  // namespace
}  // namespace maneuver::data
