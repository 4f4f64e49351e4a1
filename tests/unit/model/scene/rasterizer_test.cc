// What is drawn in which place and channel, and how bright.
#include "model/scene/rasterizer.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/scene/scene_fixture.h"

namespace maneuver::scene::rasterizer_test {
namespace {

constexpr int64_t kTarget = 1;
constexpr int kNowTarget = 3;  // channels of SmallSpec
constexpr int kNowOthers = 6;
const Pose2 kOrigin;

TEST(RasterSpecTest, CountsChannelsAndBytes) {
  const v1::RasterSpec spec = SmallSpec();
  EXPECT_EQ(RasterChannels(spec), 9);
  EXPECT_EQ(RasterBytes(spec), 12u * 16u * 9u);
  EXPECT_EQ(OtherAgentsChannel(spec), kNowOthers);
}

TEST(RasterizerTest, WritesEveryByteEvenOfAnEmptyScene) {
  const Picture raster = Draw(SmallSpec(), {}, 0.0, kTarget, kOrigin);
  for (const uint8_t value : raster.bytes()) ASSERT_EQ(value, 0);
}

TEST(RasterizerTest, TargetBoxFillsExactlyItsPixels) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0), 0.0, 0, 0, 0);
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  // x from -2 to 2: columns 6 to 9; y from -1 to 1: rows 5 and 6.
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 16; ++column) {
      for (int channel = 0; channel < 9; ++channel) {
        const bool inside =
            channel == kNowTarget && row >= 5 && row <= 6 && column >= 6 && column <= 9;
        ASSERT_EQ(raster.at(row, column, channel), inside ? 255 : 0)
            << row << " " << column << " " << channel;
      }
    }
  }
}

TEST(RasterizerTest, DrawsAheadToTheRightAndLeftUpwards) {
  // The target drives along +y of the world. Another car is 4 m ahead of it and 2 m to its left.
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0), 0.0, 50, 30, M_PI / 2);
  AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, 2.0, 2.0), 0.0, 48, 34, M_PI / 2);
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, Pose2(50, 30, M_PI / 2));
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 16; ++column) {
      // x from 3 to 5: columns 11 and 12; y from 1 to 3: rows 3 and 4.
      const bool inside = row >= 3 && row <= 4 && column >= 11 && column <= 12;
      ASSERT_EQ(raster.at(row, column, kNowOthers), inside ? 255 : 0) << row << " " << column;
    }
  }
}

TEST(RasterizerTest, ABoxThatTurnsLeftPointsUp) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, 8.0, 1.0), 0.0, 0, 0, M_PI / 4);
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  for (int i = -2; i < 2; ++i) {
    // The centres of these pixels lie on the box's centreline, or on its mirror image.
    EXPECT_EQ(raster.at(5 - i, 8 + i, kNowOthers), 255) << i;
    EXPECT_LT(raster.at(6 + i, 8 + i, kNowOthers), i == 0 || i == -1 ? 256 : 1) << i;
  }
}

TEST(RasterizerTest, TargetPositionMovesTheTargetAlongThePicture) {
  v1::RasterSpec spec = SmallSpec();
  spec.set_target_position(0.25);  // u = 4
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 2.0, 2.0), 0.0, 0, 0, 0);
  const Picture raster = Draw(spec, scenario, 0.0, kTarget, kOrigin);
  EXPECT_EQ(raster.at(5, 2, kNowTarget), 0);
  EXPECT_EQ(raster.at(5, 3, kNowTarget), 255);
  EXPECT_EQ(raster.at(5, 4, kNowTarget), 255);
  EXPECT_EQ(raster.at(5, 5, kNowTarget), 0);
}

TEST(RasterizerTest, MetersPerPixelSetsTheScale) {
  v1::RasterSpec spec = SmallSpec();
  spec.set_meters_per_pixel(0.5);
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 4.0, 2.0), 0.0, 0, 0, 0);
  const Picture raster = Draw(spec, scenario, 0.0, kTarget, kOrigin);
  EXPECT_EQ(raster.Sum(kNowTarget), 255 * 8 * 4);
  EXPECT_EQ(raster.at(4, 4, kNowTarget), 255);
  EXPECT_EQ(raster.at(7, 11, kNowTarget), 255);
}

TEST(RasterizerTest, ACenterlineAlongARowDrawsOnlyThatRow) {
  v1::Scenario scenario;
  // y = 1.5 is v = 4.5, the middle of row 4.
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-100, 1.5}, {0, 1.5}, {100, 1.5}});
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 16; ++column) {
      ASSERT_EQ(raster.at(row, column, kLaneChannel), row == 4 ? 255 : 0) << row << " " << column;
    }
  }
  for (int channel = 1; channel < 9; ++channel) EXPECT_EQ(raster.Sum(channel), 0) << channel;
}

TEST(RasterizerTest, ACenterlineThroughTheTargetDrawsBothMiddleRowsHalf) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-100, 0}, {100, 0}});
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  for (int column = 0; column < 16; ++column) {
    EXPECT_EQ(raster.at(4, column, kLaneChannel), 0);
    EXPECT_EQ(raster.at(5, column, kLaneChannel), 128);  // 127.5
    EXPECT_EQ(raster.at(6, column, kLaneChannel), 128);
    EXPECT_EQ(raster.at(7, column, kLaneChannel), 0);
  }
}

struct FeatureCase {
  v1::MapFeatureType type;
  int channel;
  int intensity;
};

class FeatureTest : public testing::TestWithParam<FeatureCase> {};

TEST_P(FeatureTest, IsDrawnInItsChannelAndIntensity) {
  const FeatureCase& param = GetParam();
  v1::Scenario scenario;
  // As a line, its first segment is along row 4; as an area, it covers row 4 and below; as a point,
  // it is in row 4.
  AddFeature(&scenario, param.type, {{0.5, 1.5}, {6.5, 1.5}, {6.5, -4.5}, {0.5, -4.5}});
  if (param.type == v1::MAP_FEATURE_TYPE_CROSSWALK ||
      param.type == v1::MAP_FEATURE_TYPE_SPEED_BUMP ||
      param.type == v1::MAP_FEATURE_TYPE_DRIVEWAY) {
    for (double& y : *scenario.mutable_map_features(0)->mutable_y()) y += 1.0;
  }
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  const int column = param.type == v1::MAP_FEATURE_TYPE_STOP_SIGN ? 8 : 11;
  EXPECT_EQ(raster.at(4, column, param.channel), param.intensity);
  for (int channel = 0; channel < 9; ++channel) {
    if (channel == param.channel) continue;
    EXPECT_EQ(raster.Sum(channel), 0) << channel;
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, FeatureTest,
    testing::Values(FeatureCase{v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, 0, 255},
                    FeatureCase{v1::MAP_FEATURE_TYPE_BIKE_LANE, 0, 48},
                    FeatureCase{v1::MAP_FEATURE_TYPE_ROAD_EDGE, 1, 255},
                    FeatureCase{v1::MAP_FEATURE_TYPE_ROAD_LINE, 1, 160},
                    FeatureCase{v1::MAP_FEATURE_TYPE_STOP_SIGN, 2, 255},
                    FeatureCase{v1::MAP_FEATURE_TYPE_STOP_LINE, 2, 224},
                    FeatureCase{v1::MAP_FEATURE_TYPE_SPEED_BUMP, 2, 192},
                    FeatureCase{v1::MAP_FEATURE_TYPE_CROSSWALK, 2, 128},
                    FeatureCase{v1::MAP_FEATURE_TYPE_DRIVEWAY, 2, 64}),
    [](const auto& test) {
      return v1::MapFeatureType_Name(test.param.type).substr(sizeof("MAP_FEATURE_TYPE_") - 1);
    });

TEST(RasterizerTest, FillsACrosswalkAndClosesIt) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_CROSSWALK, {{1, -2}, {3, -2}, {3, 2}, {1, 2}});
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  for (int row = 0; row < 12; ++row) {
    for (int column = 0; column < 16; ++column) {
      const bool inside = row >= 4 && row <= 7 && column >= 9 && column <= 10;
      ASSERT_EQ(raster.at(row, column, kPlaceChannel), inside ? kCrosswalkIntensity : 0);
    }
  }
}

TEST(RasterizerTest, DrawsAStopLineOfOnePointAsADisc) {
  v1::Scenario scenario;
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_LINE, {{0.5, 1.5}});
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  EXPECT_EQ(raster.at(4, 8, kPlaceChannel), kStopLineIntensity);
  EXPECT_EQ(raster.at(4, 9, kPlaceChannel), kStopLineIntensity);
  EXPECT_EQ(raster.at(4, 10, kPlaceChannel), 0);
}

TEST(RasterizerTest, AgentsOfEachTypeHaveTheirIntensity) {
  const std::pair<v1::AgentType, int> kinds[] = {{v1::AGENT_TYPE_VEHICLE, 255},
                                                 {v1::AGENT_TYPE_CYCLIST, 192},
                                                 {v1::AGENT_TYPE_PEDESTRIAN, 128},
                                                 {v1::AGENT_TYPE_OTHER, 96},
                                                 {v1::AGENT_TYPE_UNSPECIFIED, 96}};
  for (const auto& [type, intensity] : kinds) {
    v1::Scenario scenario;
    AddState(AddAgent(&scenario, 2, type, 2, 2), 0.0, 2, 2, 0);
    const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
    EXPECT_EQ(raster.at(4, 10, kNowOthers), intensity) << type;
    EXPECT_EQ(raster.Sum(kNowOthers), 4 * intensity) << type;
  }
}

TEST(RasterizerTest, DoesNotDrawWhatIsFarAway) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.0, 1e8, -1e8, 0);
  AddState(AddAgent(&scenario, 3, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.0, 11, 0, 0);
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_ROAD_EDGE, {{1e8, 1e8}, {1e8, -1e8}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_STOP_SIGN, {{-1e8, 0}});
  AddFeature(&scenario, v1::MAP_FEATURE_TYPE_CROSSWALK, {{1e8, 1e8}, {9e7, 1e8}, {1e8, 9e7}});
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  for (const uint8_t value : raster.bytes()) ASSERT_EQ(value, 0);
}

TEST(RasterizerTest, CutsWhatIsHalfOutsideAtTheEdge) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.0, 8, 0, 0);
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  EXPECT_EQ(raster.Sum(kNowOthers), 255 * 2 * 2);
  EXPECT_EQ(raster.at(5, 15, kNowOthers), 255);
  EXPECT_EQ(raster.at(5, 14, kNowOthers), 255);
}

// Validation refuses such scenes; a sanitizer would detect a write outside the raster.
TEST(RasterizerTest, NanNeverWritesOutsideTheRaster) {
  for (const double number : {std::nan(""), HUGE_VAL, -HUGE_VAL, 1e300}) {
    v1::Scenario scenario;
    for (int type = 0; type <= 9; ++type) {
      const auto feature_type = static_cast<v1::MapFeatureType>(type);
      AddFeature(&scenario, feature_type, {{0, 0}, {number, 1}, {2, number}, {3, 3}});
      AddFeature(&scenario, feature_type, {{number, number}});
      AddFeature(&scenario, feature_type, {{0, 0}, {1, 1}, {2, 0}})->add_x(number);
    }
    AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, number, 2), 0.0, 0, 0, 0);
    AddState(AddAgent(&scenario, 3, v1::AGENT_TYPE_VEHICLE, 4, number), 0.0, 0, 0, 0);
    AddState(AddAgent(&scenario, 4, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.0, number, 0, 0);
    AddState(AddAgent(&scenario, 5, v1::AGENT_TYPE_VEHICLE, 4, 2), 0.0, 0, 0, std::nan(""));
    AddState(AddAgent(&scenario, 6, v1::AGENT_TYPE_VEHICLE, 4, 2), number, 0, 0, 0);
    Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin);
  }
}

TEST(RasterizerTest, AReusedRasterizerDrawsTheSame) {
  v1::Scenario first;
  AddFeature(&first, v1::MAP_FEATURE_TYPE_DRIVEWAY, {{-20, -20}, {20, -10}, {10, 20}});
  AddFeature(&first, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-5, -5}, {5, 5}})->set_id(4);
  v1::TrafficSignal* signal = first.add_traffic_signals();
  signal->set_lane_id(4);
  signal->add_readings()->set_state(v1::TRAFFIC_SIGNAL_STATE_STOP);
  v1::Scenario second;
  AddFeature(&second, v1::MAP_FEATURE_TYPE_LANE_CENTERLINE, {{-5, 5}, {5, -5}})->set_id(4);
  const Picture alone = Draw(SmallSpec(), second, 0.0, kTarget, kOrigin);

  Rasterizer rasterizer(SmallSpec());
  Raster raster = NewRaster(SmallSpec());
  for (const v1::Scenario* scenario : {&first, &second}) {
    const auto map = RoadMap::Over(scenario->map_features());
    rasterizer.Rasterize(*scenario, map, 0.0, kTarget, kOrigin, {}, &raster);
  }
  EXPECT_EQ(Picture(SmallSpec(), raster).bytes(), alone.bytes());
}

TEST(RasterViewTest, ShiftsMoveTheTargetAheadAndToTheLeft) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, kTarget, v1::AGENT_TYPE_VEHICLE, 2, 2), 0.0, 0, 0, 0);
  const RasterView view{.scale = 1.0, .shift_x = 3.0, .shift_y = 2.0};
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin, view);
  EXPECT_EQ(raster.Sum(kNowTarget), 255 * 4);
  EXPECT_EQ(raster.at(3, 10, kNowTarget), 255);  // from (5, 7): three right, two up
  EXPECT_EQ(raster.at(4, 11, kNowTarget), 255);
}

TEST(RasterViewTest, ScaleMakesTheWorldLargerAboutTheTarget) {
  v1::Scenario scenario;
  AddState(AddAgent(&scenario, 2, v1::AGENT_TYPE_VEHICLE, 2, 1), 0.0, 2, 1.5, 0);
  const RasterView view{.scale = 2.0, .shift_x = 0.0, .shift_y = 0.0};
  const Picture raster = Draw(SmallSpec(), scenario, 0.0, kTarget, kOrigin, view);
  // x from 1 to 3 becomes u from 10 to 14; y from 1 to 2 becomes v from 2 to 4.
  EXPECT_EQ(raster.Sum(kNowOthers), 255 * 4 * 2);
  EXPECT_EQ(raster.at(2, 10, kNowOthers), 255);
  EXPECT_EQ(raster.at(3, 13, kNowOthers), 255);
}

}  // namespace
}  // namespace maneuver::scene::rasterizer_test
