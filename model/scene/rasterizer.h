// A bird's-eye picture of a scenario, as the networks see it.
//
// Projection. The picture is taken from above, straight down and to scale, by a camera that is
// fixed to the target. Three frames matter:
//
//   W  the world: metres, right-handed, counter-clockwise angles.
//   T  the target: origin at the centre of its box, +x along its heading, +y to its left, metres.
//   P  the picture: u counts columns to the right, v counts rows downwards, in pixels, from the
//      picture's upper left corner. Pixel (row r, column c) covers [c, c+1) x [r, r+1), so its
//      centre is at (c + 0.5, r + 0.5).
//
// The target drives to the right, and its left is up:
//
//             u = 0        u_o                            u = W
//      v = 0   +------------+------------------------------+
//              |            ^ +y (left)                    |
//              |            |                              |
//    v = H/2   |            T----> +x (heading)            |
//              |                                           |
//      v = H   +-------------------------------------------+
//
// Let m be meters_per_pixel, H x W the size and a = target_position, the share of the picture that
// lies behind the target. A point P at p_WP first goes to the target's frame, p_TP = X_WT^-1 p_WP,
// and then, because rows count downwards while y counts upwards,
//
//      u = a W + x / m
//      v = H/2 - y / m          (x, y) = p_TP.
//
// So the picture shows x from -a W m to (1 - a) W m and y from -H m / 2 to H m / 2, and the
// target's own centre lies at u_o = a W, between two rows where H is even. A RasterView with scale
// k and shifts (d_x, d_y) pixels puts the point at
//
//      u = a W + k x / m + d_x
//      v = H/2 - k y / m - d_y.
//
// Moving the whole world, target included, by any SE(2) transform changes X_WT likewise, leaves
// p_TP as it was, and with it the picture. Mirroring the world about the target's x axis (y and
// headings change sign) maps v to H - v: it swaps row r with row H - 1 - r.
//
// Channels, with h = history_frames and frame i at the time t - i * frame_interval:
//
//      0              lanes: centrelines, dimmer where the lane's signal shows red or yellow;
//                     bicycle lanes, much dimmer
//      1              lines: road edges, painted lines
//      2              places: stop signs, stop lines, crosswalks, speed bumps, driveways
//      3 + i          the target's box in frame i,        i = 0 .. h-1 (0 is now)
//      3 + h + i      all other agents' boxes in frame i
//
// Intensities are the constants below. Lines are one pixel wide whatever the scale, and
// antialiased; points that lie within 0.05 pixels of a straight line through those before and after
// them may be left out; areas and boxes are to scale, and a pixel has the share of the intensity of
// which its area is covered. Where things overlap the brighter one is seen. A box is drawn in frame
// i where the agent's state nearest to that time puts it; if none lies within half a frame
// interval, the agent is absent from that frame. Nothing is interpolated or carried over.

#ifndef MANEUVER_MODEL_SCENE_RASTERIZER_H_
#define MANEUVER_MODEL_SCENE_RASTERIZER_H_

#include <climits>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"
#include "model/scene/raster.h"
#include "model/scene/road_map.h"

namespace maneuver::scene {

// Channel 0. A lane shows what its signal's latest reading at or before the raster's time says; the
// most restrictive one if several signals name the lane.
inline constexpr uint8_t kLaneIntensity = 255;  // green, unknown or no signal
inline constexpr uint8_t kLaneCautionIntensity = 176;
inline constexpr uint8_t kLaneStopIntensity = 96;
inline constexpr uint8_t kBikeLaneIntensity = 48;
// Channel 1.
inline constexpr uint8_t kRoadEdgeIntensity = 255;
inline constexpr uint8_t kRoadLineIntensity = 160;
// Channel 2.
inline constexpr uint8_t kStopSignIntensity = 255;  // a disc of kStopSignRadius
inline constexpr uint8_t kStopLineIntensity = 224;  // a disc likewise if it is one point
inline constexpr uint8_t kSpeedBumpIntensity = 192;
inline constexpr uint8_t kCrosswalkIntensity = 128;
inline constexpr uint8_t kDrivewayIntensity = 64;
inline constexpr double kStopSignRadius = 1.5;  // pixels
// Boxes of agents.
inline constexpr uint8_t kVehicleIntensity = 255;
inline constexpr uint8_t kCyclistIntensity = 192;
inline constexpr uint8_t kPedestrianIntensity = 128;
inline constexpr uint8_t kOtherIntensity = 96;

// First channels of each kind.
inline constexpr int kLaneChannel = 0;
inline constexpr int kLineChannel = 1;
inline constexpr int kPlaceChannel = 2;
inline constexpr int kTargetChannel = 3;
inline int OtherAgentsChannel(const v1::RasterSpec& spec) {
  return kTargetChannel + spec.history_frames();
}

// How a raster departs from the spec, for augmentation. The default departs in nothing.
struct RasterView {
  double scale = 1.0;    // metres in the world appear this many times as long
  double shift_x = 0.0;  // the target stands so many pixels further along +x, ...
  double shift_y = 0.0;  // ... and +y of its frame
  int frames = INT_MAX;  // agents are drawn in the latest so many frames
  // Which of the other agents are left out, by id. Empty: none.
  std::function<bool(int64_t agent_id)> is_hidden = {};
};

// Number of channels: 3 of the map, `history_frames` of the target, as many of the others.
int RasterChannels(const v1::RasterSpec& spec);
// H * W * C.
size_t RasterBytes(const v1::RasterSpec& spec);
// Of that size, all black.
Raster NewRaster(const v1::RasterSpec& spec);

// Draws scenarios. Holds scratch memory: one for each thread.
class Rasterizer {
 public:
  // `spec` must be valid, as artifact::ValidateModelSpec says.
  explicit Rasterizer(const v1::RasterSpec& spec);
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  // Draws `scenario`, which ValidateScenario found good, as it was at `time` (which stands in for
  // its prediction_time; nothing later is looked at) from the target's frame X_WT.
  //   target_id: the agent that is drawn in the target's channels. If the scenario lacks it, these
  //     channels stay black.
  //   map: the scenario's own features (RoadMap::Over), indexed once for all targets, or others in
  //     place of them.
  //   raster: a NewRaster of the spec; what is drawn there is replaced.
  void Rasterize(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
                 const Pose2& X_WT, const RasterView& view, Raster* raster);
  // The same as [H, W, C] bytes, row-major, channels innermost; all of it is written.
  void Rasterize(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
                 const Pose2& X_WT, const RasterView& view, std::span<uint8_t> raster);
  // Likewise with the scenario's own features.
  void Rasterize(const v1::Scenario& scenario, double time, int64_t target_id, const Pose2& X_WT,
                 const RasterView& view, std::span<uint8_t> raster);

 private:
  class Painter;
  std::unique_ptr<Painter> painter_;
};

// Mirrors a raster about the target's x axis: left and right swap. In place.
void MirrorRaster(const v1::RasterSpec& spec, std::span<uint8_t> raster);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_RASTERIZER_H_
