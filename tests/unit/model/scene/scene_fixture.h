// Small scenes and rasters for the tests of this folder.

#ifndef MANEUVER_TESTS_UNIT_MODEL_SCENE_SCENE_FIXTURE_H_
#define MANEUVER_TESTS_UNIT_MODEL_SCENE_SCENE_FIXTURE_H_

#include <cstdint>
#include <initializer_list>
#include <vector>

#include "maneuver/v1/model_spec.pb.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/pose2.h"
#include "model/scene/rasterizer.h"

namespace maneuver::scene {

// Returns 12 x 16 pixels of one metre with the target in the middle (x from -8 to 8, y from -6 to
// 6) and three frames 0.1 s apart.
inline v1::RasterSpec SmallSpec() {
  v1::RasterSpec spec;
  spec.set_height(12);
  spec.set_width(16);
  spec.set_meters_per_pixel(1.0);
  spec.set_target_position(0.5);
  spec.set_history_frames(3);
  spec.mutable_frame_interval()->set_nanos(100'000'000);
  return spec;
}

inline v1::Agent* AddAgent(v1::Scenario* scenario, int64_t id, v1::AgentType type, double length,
                           double width) {
  v1::Agent* agent = scenario->add_agents();
  agent->set_id(id);
  agent->set_type(type);
  agent->set_length(length);
  agent->set_width(width);
  return agent;
}

inline void AddState(v1::Agent* agent, double time, double x, double y, double heading) {
  v1::AgentState* state = agent->add_states();
  state->set_time(time);
  state->set_x(x);
  state->set_y(y);
  state->set_heading(static_cast<float>(heading));
}

inline v1::MapFeature* AddFeature(v1::Scenario* scenario, v1::MapFeatureType type,
                                  std::initializer_list<Point2> points) {
  v1::MapFeature* feature = scenario->add_map_features();
  feature->set_type(type);
  for (const Point2& point : points) {
    feature->add_x(point.x);
    feature->add_y(point.y);
  }
  return feature;
}

// The pixels of a raster.
class Picture {
 public:
  Picture(const v1::RasterSpec& spec, const Raster& raster)
      : spec_(spec), bytes_(RasterBytes(spec), 0xA5) {
    raster.WriteInterleaved(bytes_);
  }

  int at(int row, int column, int channel) const {
    return bytes_[(static_cast<size_t>(row) * spec_.width() + column) * RasterChannels(spec_) +
                  channel];
  }
  int64_t Sum(int channel) const {
    int64_t sum = 0;
    for (size_t i = channel; i < bytes_.size(); i += RasterChannels(spec_)) sum += bytes_[i];
    return sum;
  }
  const std::vector<uint8_t>& bytes() const { return bytes_; }

 private:
  v1::RasterSpec spec_;
  std::vector<uint8_t> bytes_;
};

inline Picture Draw(const v1::RasterSpec& spec, const v1::Scenario& scenario, double time,
                    int64_t target_id, const Pose2& X_WT, const RasterView& view = {}) {
  Raster raster = NewRaster(spec);
  Rasterizer(spec).Rasterize(scenario, RoadMap::Over(scenario.map_features()), time, target_id,
                             X_WT, view, &raster);
  return Picture(spec, raster);
}

}  // namespace maneuver::scene

#endif  // MANEUVER_TESTS_UNIT_MODEL_SCENE_SCENE_FIXTURE_H_
