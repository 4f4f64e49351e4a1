#include "server/security/listen_address.h"

#include <gtest/gtest.h>

namespace maneuver::security::listen_address_test {
namespace {

TEST(ListenAddressTest, SplitsHostAndPort) {
  EXPECT_EQ(ParseListenAddress("127.0.0.1:8470")->port, 8470);
  EXPECT_EQ(ParseListenAddress("[::1]:0")->host, "::1");
  EXPECT_EQ(ParseListenAddress("[::1]:80")->ToString(), "[::1]:80");
  for (const char* text : {"", "8470", ":8470", "localhost:", "localhost:x", "h:65536", "h:-1",
                           "::1:80", "h:1 ", "h:+1", "[[::1]]:80", "[h:80"}) {
    EXPECT_FALSE(ParseListenAddress(text).ok()) << text;
  }
}

TEST(ListenAddressTest, RecognisesLoopbackAddresses) {
  for (const char* host : {"127.0.0.1", "127.1.2.3", "::1", "localhost"}) {
    EXPECT_TRUE(IsLoopback({host, 1})) << host;
  }
  for (const char* host : {"0.0.0.0", "::", "10.0.0.1", "example.com", "128.0.0.1",
                           "127.0.0.1.example.com", "localhost.example.com"}) {
    EXPECT_FALSE(IsLoopback({host, 1})) << host;
  }
}

TEST(ListenAddressTest, RefusesPlainTextExposureUnlessAskedFor) {
  EXPECT_TRUE(CheckExposure({"127.0.0.1", 1}, false, false).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(CheckExposure({"0.0.0.0", 1}, false, false)));
  EXPECT_TRUE(CheckExposure({"0.0.0.0", 1}, true, false).ok());
  EXPECT_TRUE(CheckExposure({"0.0.0.0", 1}, false, true).ok());
}

}  // namespace
}  // namespace maneuver::security::listen_address_test
