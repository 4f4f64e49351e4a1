// TO BE WRITTEN by the owner of model/scene: the class comment derives the projection.
#ifndef MANEUVER_MODEL_SCENE_RASTERIZER_H_
#define MANEUVER_MODEL_SCENE_RASTERIZER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"

namespace maneuver::scene {

// How a raster departs from the spec, for augmentation. The default departs in nothing.
struct RasterView {
  double scale = 1.0;     // metres in the world appear this many times as long
  double shift_x = 0.0;   // the target stands so many pixels further along +x, ...
  double shift_y = 0.0;   // ... and +y of its frame
};

// Number of channels: 3 of the map, `history_frames` of the target, as many of the others.
int RasterChannels(const v1::RasterSpec& spec);
// H * W * C.
size_t RasterBytes(const v1::RasterSpec& spec);
// Half a frame interval: how far a state may lie from a frame's time, seconds.
double FrameTolerance(const v1::RasterSpec& spec);

// Draws scenarios. Holds scratch memory: one for each thread.
class Rasterizer {
 public:
  explicit Rasterizer(const v1::RasterSpec& spec);

  // Draws `scenario` as it was at `time` (which stands in for its prediction_time; nothing later is
  // looked at) from the target's frame X_WT.
  //   raster: [H, W, C] bytes, row-major, channels innermost; all of it is written.
  void Rasterize(const v1::Scenario& scenario, double time, int64_t target_id, const Pose2& X_WT,
                 const RasterView& view, std::span<uint8_t> raster);
};

// Mirrors a raster about the target's x axis: left and right swap. In place.
void MirrorRaster(const v1::RasterSpec& spec, std::span<uint8_t> raster);

}  // namespace maneuver::scene

#endif  // MANEUVER_MODEL_SCENE_RASTERIZER_H_
