#include "model/kernels/crc32c.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::crc32c_test {
namespace {

class Crc32cTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(Crc32cTest);

// RFC 3720, appendix B.4, and the check value of the CRC catalogue.
TEST_P(Crc32cTest, AgreesWithPublishedVectors) {
  std::string rising;
  for (int i = 0; i < 32; ++i) rising.push_back(static_cast<char>(i));
  EXPECT_EQ(Crc32c(""), 0u);
  EXPECT_EQ(Crc32c("123456789"), 0xE3069283u);
  EXPECT_EQ(Crc32c(std::string(32, '\0')), 0x8A9136AAu);
  EXPECT_EQ(Crc32c(std::string(32, '\xFF')), 0x62A8AB43u);
  EXPECT_EQ(Crc32c(rising), 0x46DD794Eu);
}

TEST_P(Crc32cTest, EqualsPlainAtEveryLengthAndAlignment) {
  std::string bytes;
  for (int i = 0; i < 100; ++i) bytes.push_back(static_cast<char>(i * i + 7 * i));
  for (size_t start = 0; start < 9; ++start) {
    for (size_t size = 0; start + size <= bytes.size(); ++size) {
      const auto checksum = [&] { return Crc32c(std::string_view(bytes).substr(start, size)); };
      ASSERT_EQ(checksum(), Plain(checksum)) << start << " " << size;
    }
  }
}

TEST_P(Crc32cTest, PiecesGiveTheChecksumOfTheWhole) {
  const std::string_view bytes = "123456789";
  for (size_t cut = 0; cut <= bytes.size(); ++cut) {
    EXPECT_EQ(ExtendCrc32c(Crc32c(bytes.substr(0, cut)), bytes.substr(cut)), 0xE3069283u);
  }
}

}  // namespace
}  // namespace maneuver::kernels::crc32c_test
