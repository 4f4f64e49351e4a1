#include "model/scene/canvas.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "model/scene/lanes.h"

namespace maneuver::scene {

Canvas::Canvas(int height, int width, int channels)
    : height_(height),
      width_(width),
      channels_(channels),
      stride_((width + 2 * kLanes - 1) / kLanes * kLanes),
      planes_(static_cast<size_t>(channels) * height * stride_),
      painted_(channels),
      area_gain_(static_cast<size_t>(height) * (static_cast<size_t>(width) + 2)) {
  assert(height > 0 && width > 0 && channels > 0);
}

uint8_t* Canvas::RowsToPaint(int channel, int first, int end) {
  Rows& painted = painted_[channel];
  if (first < end) {
    painted = painted.first < painted.end
                  ? Rows{std::min(painted.first, first), std::max(painted.end, end)}
                  : Rows{first, end};
  }
  return &planes_[(static_cast<size_t>(channel) * height_ + first) * stride_];
}

void Canvas::Finish(std::span<uint8_t> picture) {
  assert(picture.size() == static_cast<size_t>(height_) * width_ * channels_);
  std::memset(picture.data(), 0, picture.size());
  for (int channel = 0; channel < channels_; ++channel) {
    Rows& painted = painted_[channel];
    if (painted.first >= painted.end) continue;
    uint8_t* const plane = &planes_[static_cast<size_t>(channel) * height_ * stride_];
    for (int row = painted.first; row < painted.end; ++row) {
      const uint8_t* from = plane + static_cast<size_t>(row) * stride_;
      uint8_t* to = picture.data() + static_cast<size_t>(row) * width_ * channels_ + channel;
      for (int column = 0; column < width_; column += kLanes) {
        // Most of a picture is black.
        uint64_t lanes = 0;
        static_assert(sizeof(lanes) == kLanes);
        std::memcpy(&lanes, from + column, sizeof(lanes));
        if (lanes == 0) continue;
        const int count = std::min(kLanes, width_ - column);
        for (int i = 0; i < count; ++i) to[(column + i) * channels_] = from[column + i];
      }
    }
    std::memset(plane + static_cast<size_t>(painted.first) * stride_, 0,
                static_cast<size_t>(painted.end - painted.first) * stride_);
    painted = {};
  }
}

}  // namespace maneuver::scene
