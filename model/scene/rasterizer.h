// A bird's-eye picture of a scenario, as the networks read it.
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
// Let m be meters_per_pixel, H x W the size and a = target_position, the share of the picture's
// width that lies behind the target. A point P at p_WP is first transformed to the target's frame,
// p_TP = X_WT^-1 p_WP. Rows count downwards while y counts upwards, so
//
//      u = a W + x / m
//      v = H/2 - y / m          (x, y) = p_TP.
//
// The picture shows x from -a W m to (1 - a) W m and y from -H m / 2 to H m / 2. The target's
// centre lies at u_o = a W, between two rows if H is even. A RasterView with scale k and shifts
// (d_x, d_y) pixels puts the point at
//
//      u = a W + k x / m + d_x
//      v = H/2 - k y / m - d_y.
//
// An SE(2) transform of the whole world, target included, changes X_WT by the same transform. p_TP
// and the picture stay the same. Mirroring the world about the target's x axis (y and headings
// change sign) maps v to H - v: it swaps row r with row H - 1 - r.
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
// antialiased. A point may be skipped if it lies within 0.05 pixels of a straight line through its
// neighbours. Areas and boxes are to scale; a pixel gets the intensity times the share of its area
// that is covered. Where shapes overlap, the brighter one shows. In frame i an agent's box is drawn
// at the state nearest to that frame's time. An agent without a state within half a frame interval
// is absent from that frame. Nothing is interpolated or carried over.

#ifndef MANEUVER_MODEL_SCENE_RASTERIZER_H_
#define MANEUVER_MODEL_SCENE_RASTERIZER_H_

#include <climits>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"
#include "model/scene/raster.h"
#include "model/scene/road_map.h"

namespace maneuver::scene {

// Channel 0. A lane shows its signal's latest reading at or before the raster's time. If several
// signals name the lane, it shows the most restrictive one.
inline constexpr uint8_t kLaneIntensity = 255;  // green, unknown or no signal
inline constexpr uint8_t kLaneCautionIntensity = 176;
inline constexpr uint8_t kLaneStopIntensity = 96;
inline constexpr uint8_t kBikeLaneIntensity = 48;
// Channel 1.
inline constexpr uint8_t kRoadEdgeIntensity = 255;
inline constexpr uint8_t kRoadLineIntensity = 160;
// Channel 2.
inline constexpr uint8_t kStopSignIntensity = 255;  // a disc of kStopSignRadius
inline constexpr uint8_t kStopLineIntensity = 224;  // a disc of kStopSignRadius if it is one point
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

// How a raster departs from its spec, for augmentation. The default changes nothing.
struct RasterView {
  double scale = 1.0;    // lengths in the world appear this many times as long
  double shift_x = 0.0;  // pixels that the target moves along +x of its frame
  double shift_y = 0.0;  // pixels that the target moves along +y of its frame
  int frames = INT_MAX;  // agents are drawn in this many of the latest frames
  // Returns whether another agent is left out. Empty: none is.
  std::function<bool(int64_t agent_id)> is_hidden = {};
};

// Returns the number of channels: 3 of the map, history_frames of the target, history_frames of the
// others.
int RasterChannels(const v1::RasterSpec& spec);
// Returns H * W * C.
size_t RasterBytes(const v1::RasterSpec& spec);
// Returns a raster of that size whose pixels are all 0.
Raster NewRaster(const v1::RasterSpec& spec);

// Draws scenarios. Holds scratch memory: use one per thread.
class Rasterizer {
 public:
  // artifact::ValidateModelSpec must accept `spec`.
  explicit Rasterizer(const v1::RasterSpec& spec);
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  // Draws `scenario` as it was at `time`, which replaces its prediction_time, from the target's
  // frame X_WT. Reads nothing later. ValidateScenario must accept the scenario.
  //   target_id: the agent that is drawn in the target's channels. If the scenario lacks it, those
  //     channels stay 0.
  //   map: the scenario's own features (RoadMap::Over), indexed once for all targets, or other
  //     features that replace them.
  //   raster: from NewRaster(spec); its content is replaced.
  void Rasterize(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
                 const Pose2& X_WT, const RasterView& view, Raster* raster);

 private:
  class Painter;
  std::unique_ptr<Painter> painter_;
};

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_RASTERIZER_H_
