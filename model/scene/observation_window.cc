#include "model/scene/observation_window.h"

#include <algorithm>

namespace maneuver::scene {

ObservationWindow WindowOf(const v1::ModelSpec& spec) {
  if (!spec.has_raster()) return {};
  const v1::RasterSpec& raster = spec.raster();
  const double interval = static_cast<double>(raster.frame_interval().seconds()) +
                          1e-9 * raster.frame_interval().nanos();
  return {.past = std::max(0, raster.history_frames() - 1) * interval, .frame_interval = interval};
}

}  // namespace maneuver::scene
