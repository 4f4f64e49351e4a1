#include "server/security/identities.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "model/files/digest.h"

namespace maneuver::security::identities_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// SHA-256 of "abc" (FIPS 180-2, B.1).
constexpr char kAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

TEST(IdentitiesTest, FindsATokenByItsHash) {
  const auto identities = Identities::Parse(std::string("# people\n\n  planner\tpredict,admin   "
                                                        "sha256:") +
                                            kAbc + "  \r\n");
  ASSERT_TRUE(identities.ok()) << identities.status();
  const Identity* found = identities->FindToken("abc");
  ASSERT_NE(found, nullptr);
  EXPECT_EQ(found->name, "planner");
  EXPECT_EQ(found->roles.ToString(), "predict,admin");
  for (const char* other : {"", "ab", "abcd", "Abc", kAbc}) {
    EXPECT_EQ(identities->FindToken(other), nullptr) << other;
  }
}

TEST(IdentitiesTest, FindsACertificateByOneOfItsNames) {
  const auto identities = Identities::Parse(
      "a predict san:a.example\nb train san:spiffe://x/b\nc admin cn:Ada Lovelace\n");
  ASSERT_TRUE(identities.ok()) << identities.status();
  EXPECT_EQ(identities->FindCertificate({"x", "a.example"}, "")->name, "a");
  EXPECT_EQ(identities->FindCertificate({"spiffe://x/b"}, "y")->name, "b");
  EXPECT_EQ(identities->FindCertificate({}, "Ada Lovelace")->name, "c");
  // A name of one kind does not match another kind, and no token is a name.
  EXPECT_EQ(identities->FindCertificate({"Ada Lovelace"}, "a.example"), nullptr);
  EXPECT_EQ(identities->FindCertificate({}, ""), nullptr);
  EXPECT_EQ(identities->FindToken("a.example"), nullptr);
}

TEST(IdentitiesTest, AnAlternativeNameIsAnAddressAUriOrADnsName) {
  for (const char* address : {"10.1.2.3", "2001:db8::1", "::1"}) {
    EXPECT_EQ(KindOf(address), NameKind::kAddress) << address;
  }
  for (const char* uri : {"spiffe://x/b", "urn:uuid:1", "2001:db8::x"}) {
    EXPECT_EQ(KindOf(uri), NameKind::kUri) << uri;
  }
  for (const char* name : {"a.example", "10.1.2", "10.1.2.3.4", "*.example"}) {
    EXPECT_EQ(KindOf(name), NameKind::kDns) << name;
  }
  // Addresses of certificates are written in one way.
  const auto identities = Identities::Parse("a predict san:2001:DB8:0::0001\n");
  ASSERT_TRUE(identities.ok()) << identities.status();
  EXPECT_NE(identities->FindCertificate({"2001:db8::1"}, ""), nullptr);
}

TEST(IdentitiesTest, NamesAnInvalidLineWithoutItsContent) {
  const std::string digest = std::string("sha256:") + kAbc;
  for (const std::string& line : std::vector<std::string>{
           "secret",
           "secret predict",
           "secret fly " + digest,
           "secret predict, train " + digest,
           "secret predict,, " + digest,
           "secret predict secret",
           "secret predict sha256:",
           "secret predict sha256:abcd",
           "secret predict SHA256:" + std::string(kAbc),
           "secret predict sha256:" + std::string(64, 'G'),
           "secret predict " + digest + "0",
           "secret predict " + digest + " expires=",
           "secret predict " + digest + " expires=secret",
           "secret predict " + digest + " expires=2027-01-31",
           "secret predict " + digest + " until=2027-01-31T00:00:00Z",
           "secret predict " + digest + " expires=2027-01-31T00:00:00Z secret",
           "secret predict san:",
           "secret predict cn:",
           "secret/x predict " + digest,
           std::string(64, 's') + " predict " + digest,
       }) {
    const auto identities = Identities::Parse("ok predict cn:x\n" + line + "\n");
    ASSERT_FALSE(identities.ok()) << line;
    EXPECT_THAT(identities.status().message(), HasSubstr("line 2: "));
    EXPECT_THAT(identities.status().message(), Not(HasSubstr("secret")));
  }
}

TEST(IdentitiesTest, ANewTokenMatchesItsLine) {
  RoleSet roles;
  roles.Add(Role::kTrain);
  std::set<std::string> tokens;
  for (int i = 0; i < 100; ++i) tokens.insert(NewToken());
  EXPECT_EQ(tokens.size(), 100u);
  const std::string token = *tokens.begin();
  EXPECT_EQ(token.size(), 4 + 64u);
  const auto line = TokenLine("fleet-2", roles, token);
  ASSERT_TRUE(line.ok());
  EXPECT_THAT(*line, Not(HasSubstr(token)));
  const auto identities = Identities::Parse(*line);
  ASSERT_TRUE(identities.ok()) << identities.status();
  EXPECT_EQ(identities->FindToken(token)->name, "fleet-2");
  EXPECT_FALSE(TokenLine("a b", roles, token).ok());
}

TEST(IdentitiesTest, ATokenExpiresAtTheTimeThatItsLineNames) {
  // 1 800 000 000 s after the epoch is 2027-01-15 08:00:00 UTC, by date(1).
  const absl::Time noon = absl::FromUnixSeconds(1'800'000'000);
  RoleSet roles;
  roles.Add(Role::kPredict);
  const auto line = TokenLine("guest", roles, "abc", noon);
  ASSERT_TRUE(line.ok());
  EXPECT_EQ(*line, std::string("guest predict sha256:") + kAbc + " expires=2027-01-15T08:00:00Z\n");
  const auto identities = Identities::Parse(*line);
  ASSERT_TRUE(identities.ok()) << identities.status();
  const Identity* guest = identities->FindToken("abc");
  ASSERT_NE(guest, nullptr);
  EXPECT_FALSE(guest->HasExpired(noon - absl::Seconds(1)));
  EXPECT_TRUE(guest->HasExpired(noon));
  EXPECT_FALSE(identities->AnyExpired(noon - absl::Seconds(2), noon - absl::Seconds(1)));
  EXPECT_TRUE(identities->AnyExpired(noon - absl::Seconds(1), noon));
  EXPECT_FALSE(identities->AnyExpired(noon, noon + absl::Seconds(1)));
}

TEST(IdentitiesTest, AnExpiryMayHaveAnotherTimeZone) {
  const auto identities = Identities::Parse(std::string("guest predict sha256:") + kAbc +
                                            " expires=2027-01-15T10:00:00+02:00\n");
  ASSERT_TRUE(identities.ok()) << identities.status();
  EXPECT_EQ(identities->FindToken("abc")->expires, absl::FromUnixSeconds(1'800'000'000));
}

}  // namespace
}  // namespace maneuver::security::identities_test
