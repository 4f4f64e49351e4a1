#include "model/files/utf8.h"

#include <gtest/gtest.h>

#include <string>

namespace maneuver::files::utf8_test {
namespace {

TEST(Utf8Test, KnowsTheLengthOfACharacter) {
  EXPECT_EQ(Utf8Length("ab"), 1u);
  EXPECT_EQ(Utf8Length("\xc3\xbc!"), 2u);
  EXPECT_EQ(Utf8Length("\xe2\x86\x92"), 3u);
  EXPECT_EQ(Utf8Length("\xf0\x9f\x9a\x97"), 4u);
}

// Of the table of well-formed sequences in the Unicode standard: what is just outside of it.
TEST(Utf8Test, RefusesBytesThatAreNotACharacter) {
  for (const char* wrong :
       {"\x80", "\xc1\xbf", "\xc3", "\xc3(", "\xe0\x9f\xbf", "\xed\xa0\x80", "\xe2\x86",
        "\xf0\x8f\xbf\xbf", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff"}) {
    EXPECT_EQ(Utf8Length(wrong), 0u) << wrong;
  }
}

TEST(Utf8Test, TextIsUtf8IfAllOfItsCharactersAre) {
  for (const char* text : {"", "abc", "B\xc3\x9b", "\xf0\x9f\x9a\x97", "\x01"}) {
    EXPECT_TRUE(IsUtf8(text)) << text;
  }
  for (const char* text : {"\xff", "a\xc3", "\xc3\x28", "\xed\xa0\x80", "b\x80"}) {
    EXPECT_FALSE(IsUtf8(text)) << text;
  }
}

TEST(Utf8Test, FindsControlCharacters) {
  for (const char* text : {"a\x1b[31m", "two\nlines", "\x7f", "csi \xc2\x9b", "\xc2\x80", "a\u202e",
                           "\u2066b", "\u200f"}) {
    EXPECT_TRUE(HasUnprintableCharacters(text)) << text;
  }
  for (const char* text : {"", "stop within 12 m", "\xc2\xa0", "B\xc3\x9b", "\xe2\x9b\x94"}) {
    EXPECT_FALSE(HasUnprintableCharacters(text)) << text;
  }
}

TEST(Utf8Test, CountsCharactersAndNotBytes) {
  EXPECT_FALSE(IsLongerThan("", 0));
  EXPECT_FALSE(IsLongerThan("B\u00fcrger", 6));
  EXPECT_TRUE(IsLongerThan("B\u00fcrger", 5));
  EXPECT_FALSE(IsLongerThan("\U0001f697\U0001f697", 2));
  // These are no characters, and still take memory.
  EXPECT_TRUE(IsLongerThan(std::string(9, '\x80'), 2));
}

}  // namespace
}  // namespace maneuver::files::utf8_test
