#include "model/scene/observation_window.h"

#include <algorithm>

#include "model/scene/duration.h"

namespace maneuver::scene {

ObservationWindow WindowOf(const v1::ModelSpec& spec) {
  if (!spec.has_raster()) return {};
  const v1::RasterSpec& raster = spec.raster();
  const double interval = ToSeconds(raster.frame_interval());
  return {.past = std::max(0, raster.history_frames() - 1) * interval, .frame_interval = interval};
}

}  // namespace maneuver::scene
