#include "model/scene/observation_window.h"

#include <gtest/gtest.h>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::observation_window_test {
namespace {

TEST(ObservationWindowTest, FollowsTheFramesOfTheRaster) {
  v1::ModelSpec spec;
  *spec.mutable_raster() = SmallSpec();  // three frames a tenth of a second apart
  const ObservationWindow window = WindowOf(spec);
  EXPECT_DOUBLE_EQ(window.past, 0.2);
  EXPECT_DOUBLE_EQ(window.tolerance(), 0.05);
  EXPECT_DOUBLE_EQ(window.max_gap(), 0.25);
}

TEST(ObservationWindowTest, IsOneSecondWithoutARaster) {
  v1::ModelSpec spec;
  spec.mutable_scene_vectors()->set_history_width(8);
  const ObservationWindow window = WindowOf(spec);
  EXPECT_DOUBLE_EQ(window.past, 1.0);
  EXPECT_DOUBLE_EQ(window.tolerance(), 0.125);
  EXPECT_DOUBLE_EQ(window.max_gap(), 0.625);
}

}  // namespace
}  // namespace maneuver::scene::observation_window_test
