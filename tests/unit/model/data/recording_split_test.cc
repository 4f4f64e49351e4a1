#include "model/data/recording_split.h"

#include <gtest/gtest.h>

namespace maneuver::data::recording_split_test {
namespace {

TEST(HeldOutTest, HoldsOutTheShareAskedFor) {
  int held_out = 0;
  for (int i = 0; i < 4000; ++i) held_out += HeldOut("town-1-" + std::to_string(i), 0.2);
  // Binomial with mean 800 and deviation 25.3: five deviations.
  EXPECT_NEAR(held_out, 800, 127);
  EXPECT_FALSE(HeldOut("town-1-0", 0.0));
}

TEST(HeldOutTest, KeepsPartsOfOneRecordingTogether) {
  for (int i = 0; i < 100; ++i) {
    const std::string place = "crossing-" + std::to_string(i);
    EXPECT_EQ(HeldOut(PartId(place, 1), 0.5), HeldOut(place, 0.5));
    EXPECT_EQ(HeldOut(PartId(place, 2), 0.5), HeldOut(place, 0.5));
  }
}

TEST(HeldOutTest, ALargerShareHoldsOutWhatASmallerOneDid) {
  for (int i = 0; i < 200; ++i) {
    const std::string id = std::to_string(i);
    if (HeldOut(id, 0.1)) {
      EXPECT_TRUE(HeldOut(id, 0.3)) << id;
    }
  }
}

TEST(PartIdTest, WithoutPartUndoesPartId) {
  EXPECT_EQ(PartId("crossing", 2), "crossing#2");
  EXPECT_EQ(WithoutPart("crossing#2"), "crossing");
  EXPECT_EQ(WithoutPart("crossing#2#3"), "crossing");
  EXPECT_EQ(WithoutPart("crossing"), "crossing");
}

}  // namespace
}  // namespace maneuver::data::recording_split_test
