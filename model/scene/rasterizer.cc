#include "model/scene/rasterizer.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "model/kernels/points.h"
#include "model/scene/brush.h"
#include "model/scene/duration.h"
#include "model/scene/pixel_line.h"
#include "model/scene/target_frame.h"

namespace maneuver::scene {
namespace {

uint8_t BoxIntensity(v1::AgentType type) {
  switch (type) {
    case v1::AGENT_TYPE_VEHICLE:
      return kVehicleIntensity;
    case v1::AGENT_TYPE_CYCLIST:
      return kCyclistIntensity;
    case v1::AGENT_TYPE_PEDESTRIAN:
      return kPedestrianIntensity;
    default:
      return kOtherIntensity;
  }
}

// Maps from the world to the picture, as the header defines.
class Projection {
 public:
  Projection(const v1::RasterSpec& spec, const Pose2& X_WT, const RasterView& view)
      : X_WT_(X_WT),
        view_{.x = X_WT.x(),
              .y = X_WT.y(),
              .cosine = X_WT.cosine(),
              .sine = X_WT.sine(),
              .scale = view.scale / spec.meters_per_pixel(),
              .origin_u = spec.target_position() * spec.width() + view.shift_x,
              .origin_v = 0.5 * spec.height() - view.shift_y} {}

  PixelPoint operator()(const Point2& p_WP) const {
    const double dx = p_WP.x - view_.x;
    const double dy = p_WP.y - view_.y;
    return {view_.origin_u + view_.scale * (view_.cosine * dx + view_.sine * dy),
            view_.origin_v - view_.scale * (-view_.sine * dx + view_.cosine * dy)};
  }

  // For many points at once.
  const kernels::PointView& view() const { return view_; }

  // Returns the unit vector along a heading in the world.
  PixelPoint Direction(double heading) const {
    const double heading_T = heading - X_WT_.heading();
    return {std::cos(heading_T), -std::sin(heading_T)};
  }

  double pixels_per_meter() const { return view_.scale; }

  // Returns the box, in the world, around a picture of this size with a margin of `margin` pixels.
  Box Seen(double width, double height, double margin) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    Box box{kInfinity, kInfinity, -kInfinity, -kInfinity};
    for (const double u : {-margin, width + margin}) {
      for (const double v : {-margin, height + margin}) {
        const Point2 p_TP{(u - view_.origin_u) / view_.scale, (view_.origin_v - v) / view_.scale};
        const Point2 p_WP = X_WT_ * p_TP;
        box.low_x = std::min(box.low_x, p_WP.x);
        box.low_y = std::min(box.low_y, p_WP.y);
        box.high_x = std::max(box.high_x, p_WP.x);
        box.high_y = std::max(box.high_y, p_WP.y);
      }
    }
    return box;
  }

 private:
  Pose2 X_WT_;
  kernels::PointView view_;
};

}  // namespace

class Rasterizer::Painter {
 public:
  explicit Painter(const v1::RasterSpec& spec)
      : spec_(spec),
        frame_interval_(ToSeconds(spec.frame_interval())),
        tolerance_(0.5 * frame_interval_) {
    assert(spec.meters_per_pixel() > 0.0 && frame_interval_ > 0.0);
  }

  void Paint(const v1::Scenario& scenario, const RoadMap& map, double time, int64_t target_id,
             const Pose2& X_WT, const RasterView& view, Raster* raster) {
    const Projection projection(spec_, X_WT, view);
    raster_ = raster;
    raster_->Clear();
    ReadSignals(scenario, time);
    DrawMap(map, projection);
    for (const v1::Agent& agent : scenario.agents()) {
      const bool is_target = agent.id() == target_id;
      if (!is_target && view.is_hidden && view.is_hidden(agent.id())) continue;
      DrawAgent(agent, time, is_target ? kTargetChannel : OtherAgentsChannel(spec_),
                std::min(view.frames, spec_.history_frames()), projection);
    }
  }

 private:
  using LaneIntensity = std::pair<int64_t, uint8_t>;

  // How far a feature's drawing extends beyond its points, at most, pixels.
  static constexpr double kReach = 2.0;
  // Stretches of a line that bend less than this are drawn straight, pixels.
  static constexpr double kBendTolerance = 0.02;

  // Finds the lanes whose signal is not green.
  void ReadSignals(const v1::Scenario& scenario, double time) {
    dim_lanes_.clear();
    for (const v1::TrafficSignal& signal : scenario.traffic_signals()) {
      const v1::TrafficSignalReading* const reading = LatestReading(signal, time);
      if (reading == nullptr) continue;
      const v1::TrafficSignalState state = reading->state();
      if (state == v1::TRAFFIC_SIGNAL_STATE_STOP) {
        dim_lanes_.emplace_back(signal.lane_id(), kLaneStopIntensity);
      } else if (state == v1::TRAFFIC_SIGNAL_STATE_CAUTION) {
        dim_lanes_.emplace_back(signal.lane_id(), kLaneCautionIntensity);
      }
    }
    // A lane's most restrictive reading comes first: it is the dimmest.
    std::sort(dim_lanes_.begin(), dim_lanes_.end());
  }

  uint8_t LaneIntensityOf(int64_t lane_id) const {
    const auto found =
        std::lower_bound(dim_lanes_.begin(), dim_lanes_.end(), LaneIntensity(lane_id, 0));
    if (lane_id == 0 || found == dim_lanes_.end() || found->first != lane_id) return kLaneIntensity;
    return found->second;
  }

  void DrawMap(const RoadMap& map, const Projection& projection) {
    // One pixel more than the drawing extends, for rounding.
    const Box seen = projection.Seen(spec_.width(), spec_.height(), kReach + 1.0);
    const Stretches& stretches = map.stretches();
    for (int i = 0; i < map.features().size(); ++i) {
      if (!seen.Overlaps(map.boxes()[static_cast<size_t>(i)])) continue;
      const v1::MapFeature& feature = map.features()[i];
      if (IsLine(feature)) {
        DrawLine(feature, stretches[i], seen, projection);
      } else {
        corners_.clear();
        for (int point = 0; point < std::min(feature.x_size(), feature.y_size()); ++point) {
          corners_.push_back(projection({feature.x(point), feature.y(point)}));
        }
        DrawPlace(feature);
      }
    }
  }

  static bool IsLine(const v1::MapFeature& feature) {
    switch (feature.type()) {
      case v1::MAP_FEATURE_TYPE_LANE_CENTERLINE:
      case v1::MAP_FEATURE_TYPE_BIKE_LANE:
      case v1::MAP_FEATURE_TYPE_ROAD_EDGE:
      case v1::MAP_FEATURE_TYPE_ROAD_LINE:
        return true;
      case v1::MAP_FEATURE_TYPE_STOP_LINE:
        return feature.x_size() > 1;
      default:
        return false;
    }
  }

  // Appends points begin .. end-1 of the feature to line_.
  void Project(const v1::MapFeature& feature, int begin, int end, const Projection& projection) {
    const auto count = static_cast<size_t>(end - begin);
    const size_t place = line_.Extend(count);
    if (count == 1) {  // as of a straight stretch: not worth the call
      line_.Set(place, projection({feature.x(begin), feature.y(begin)}));
      return;
    }
    kernels::ProjectPoints(projection.view(), feature.x().data() + begin,
                           feature.y().data() + begin, count, line_.u() + place, line_.v() + place);
  }

  // Draws the stretches that may show; of a straight one, only the end points.
  void DrawLine(const v1::MapFeature& feature, std::span<const Stretch> stretches, const Box& seen,
                const Projection& projection) {
    constexpr int kIntervals = Stretches::kStretchPoints - 1;
    const int last = std::min(feature.x_size(), feature.y_size()) - 1;
    const double bend = kBendTolerance / projection.pixels_per_meter();
    line_.Clear();
    int first = 0;  // point of the stretch
    for (const Stretch& stretch : stretches) {
      const int end = std::min(first + kIntervals, last);
      if (seen.Overlaps(stretch.box)) {
        if (line_.empty()) Project(feature, first, first + 1, projection);
        Project(feature, stretch.squared_bend <= bend * bend ? end : first + 1, end + 1,
                projection);
      } else if (!line_.empty()) {
        DrawPoints(feature);
        line_.Clear();
      }
      first = end;
    }
    if (!line_.empty()) DrawPoints(feature);
  }

  // Draws the line line_.
  void DrawPoints(const v1::MapFeature& feature) {
    switch (feature.type()) {
      case v1::MAP_FEATURE_TYPE_LANE_CENTERLINE:
        return brush_.DrawPolyline(raster_, kLaneChannel, line_, LaneIntensityOf(feature.id()));
      case v1::MAP_FEATURE_TYPE_BIKE_LANE:
        return brush_.DrawPolyline(raster_, kLaneChannel, line_, kBikeLaneIntensity);
      case v1::MAP_FEATURE_TYPE_ROAD_EDGE:
        return brush_.DrawPolyline(raster_, kLineChannel, line_, kRoadEdgeIntensity);
      case v1::MAP_FEATURE_TYPE_ROAD_LINE:
        return brush_.DrawPolyline(raster_, kLineChannel, line_, kRoadLineIntensity);
      case v1::MAP_FEATURE_TYPE_STOP_LINE:
        return brush_.DrawPolyline(raster_, kPlaceChannel, line_, kStopLineIntensity);
      default:
        return;
    }
  }

  // Fills the area corners_, or draws a disc if it has only one point.
  void DrawPlace(const v1::MapFeature& feature) {
    switch (feature.type()) {
      case v1::MAP_FEATURE_TYPE_CROSSWALK:
        return brush_.FillPolygon(raster_, kPlaceChannel, corners_, kCrosswalkIntensity);
      case v1::MAP_FEATURE_TYPE_SPEED_BUMP:
        return brush_.FillPolygon(raster_, kPlaceChannel, corners_, kSpeedBumpIntensity);
      case v1::MAP_FEATURE_TYPE_DRIVEWAY:
        return brush_.FillPolygon(raster_, kPlaceChannel, corners_, kDrivewayIntensity);
      case v1::MAP_FEATURE_TYPE_STOP_LINE:
        return Brush::FillDisc(raster_, kPlaceChannel, corners_[0], kStopSignRadius,
                               kStopLineIntensity);
      case v1::MAP_FEATURE_TYPE_STOP_SIGN:
        return Brush::FillDisc(raster_, kPlaceChannel, corners_[0], kStopSignRadius,
                               kStopSignIntensity);
      default:
        return;
    }
  }

  using States = google::protobuf::RepeatedPtrField<v1::AgentState>;

  // Returns the first state later than `time`. States mostly come one per frame, so the index
  // follows from the first state's time. A search through a long recording would miss the cache at
  // every probe.
  States::const_iterator FirstAfter(const States& states, double time) const {
    const auto begin = states.begin();
    if (states.empty()) return begin;
    const double frames = std::floor((time - begin->time()) / frame_interval_) + 1.0;
    // 0 for NaN.
    const double place = std::min(std::max(0.0, frames), static_cast<double>(states.size()));
    const auto guess = begin + static_cast<int>(place);
    if ((guess == begin || (guess - 1)->time() <= time) &&
        (guess == states.end() || time < guess->time())) {
      return guess;
    }
    return std::upper_bound(begin, states.end(), time,
                            [](double t, const v1::AgentState& state) { return t < state.time(); });
  }

  // Draws the latest `frames` frames of an agent in one walk back through its states.
  void DrawAgent(const v1::Agent& agent, double time, int channel, int frames,
                 const Projection& projection) {
    const auto& states = agent.states();
    const auto after = FirstAfter(states, time + kSameTime);
    if (after == states.begin()) return;
    auto state = after - 1;
    for (int frame = 0; frame < frames; ++frame) {
      const double frame_time = time - frame * frame_interval_;
      while (state != states.begin() &&
             std::abs((state - 1)->time() - frame_time) < std::abs(state->time() - frame_time)) {
        --state;
      }
      if (std::abs(state->time() - frame_time) > tolerance_ + kSameTime) continue;
      DrawBox(agent, *state, channel + frame, projection);
    }
  }

  void DrawBox(const v1::Agent& agent, const v1::AgentState& state, int channel,
               const Projection& projection) {
    const PixelPoint centre = projection({state.x(), state.y()});
    const double reach = projection.pixels_per_meter() * (agent.length() + agent.width());
    if (!(centre.u > -reach && centre.u < spec_.width() + reach && centre.v > -reach &&
          centre.v < spec_.height() + reach)) {
      return;
    }
    const double half_pixels = 0.5 * projection.pixels_per_meter();
    Brush::FillBox(raster_, channel, centre, projection.Direction(state.heading()),
                   half_pixels * agent.length(), half_pixels * agent.width(),
                   BoxIntensity(agent.type()));
  }

  const v1::RasterSpec spec_;
  const double frame_interval_;
  const double tolerance_;
  Raster* raster_ = nullptr;  // the raster being drawn
  Brush brush_;
  std::vector<LaneIntensity> dim_lanes_;  // by lane id
  // The feature at hand: a line or a place.
  PixelLine line_;
  std::vector<PixelPoint> corners_;
};

int RasterChannels(const v1::RasterSpec& spec) {
  return kTargetChannel + 2 * spec.history_frames();
}

size_t RasterBytes(const v1::RasterSpec& spec) {
  return static_cast<size_t>(spec.height()) * spec.width() * RasterChannels(spec);
}

Raster NewRaster(const v1::RasterSpec& spec) {
  return {spec.height(), spec.width(), RasterChannels(spec)};
}

Rasterizer::Rasterizer(const v1::RasterSpec& spec) : painter_(std::make_unique<Painter>(spec)) {}
Rasterizer::~Rasterizer() = default;
Rasterizer::Rasterizer(Rasterizer&&) noexcept = default;
Rasterizer& Rasterizer::operator=(Rasterizer&&) noexcept = default;

void Rasterizer::Rasterize(const v1::Scenario& scenario, const RoadMap& map, double time,
                           int64_t target_id, const Pose2& X_WT, const RasterView& view,
                           Raster* raster) {
  painter_->Paint(scenario, map, time, target_id, X_WT, view, raster);
}

}  // namespace maneuver::scene
