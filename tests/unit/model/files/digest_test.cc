#include "model/files/digest.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/unit/temporary_folder.h"

namespace maneuver::files::digest_test {
namespace {

// FIPS 180-4, appendix B.
constexpr char kAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr char kTwoBlocks[] = "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1";
constexpr char kMillionA[] = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";

TEST(Sha256Test, AgreesWithPublishedVectors) {
  EXPECT_EQ(Sha256Hex("abc"), kAbc);
  EXPECT_EQ(Sha256Hex("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"), kTwoBlocks);
  EXPECT_EQ(Sha256Hex(std::string(1'000'000, 'a')), kMillionA);
}

TEST(Sha256Test, KnowsItsOwnForm) {
  const std::string digest = Sha256Hex("abc");
  EXPECT_TRUE(IsSha256Hex(digest));
  EXPECT_FALSE(IsSha256Hex(""));
  EXPECT_FALSE(IsSha256Hex(digest.substr(1)));
  EXPECT_FALSE(IsSha256Hex(digest + "0"));
  for (const char wrong : {'A', 'g', ' ', '/', ':', '`'}) {
    EXPECT_FALSE(IsSha256Hex(digest.substr(1) + wrong)) << wrong;
  }
}

TEST(Sha256Test, UpdatingByPiecesGivesTheDigestOfTheWhole) {
  Sha256 sha256;
  sha256.Update("a");
  sha256.Update("");
  sha256.Update("bc");
  EXPECT_EQ(sha256.Finish(), kAbc);
}

TEST(Sha256Test, DigestsAFileLargerThanTheReadBuffer) {
  const TemporaryFolder folder;
  WriteBytes(folder / "million_a", std::string(1'000'000, 'a'));
  const auto digest = Sha256OfFile(folder / "million_a");
  ASSERT_TRUE(digest.ok()) << digest.status();
  EXPECT_EQ(*digest, kMillionA);
}

TEST(Sha256Test, AMissingFileIsNotFound) {
  const TemporaryFolder folder;
  EXPECT_EQ(Sha256OfFile(folder / "absent").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace maneuver::files::digest_test
