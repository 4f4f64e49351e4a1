#ifndef MANEUVER_MODEL_INFERENCE_PACKET_H_
#define MANEUVER_MODEL_INFERENCE_PACKET_H_

#include <Eigen/Core>

namespace maneuver::inference {

// Eigen's widest vector of floats for this processor: 8 with AVX2, 16 with AVX-512.
using Packet = Eigen::internal::packet_traits<float>::type;
inline constexpr int kPacket = Eigen::internal::packet_traits<float>::size;

// Vectors of `Type`: whole packets, or half as wide for what does not fill those. (GCC warns of
// vectors as template arguments.)
struct WholePackets {
  using Type = Packet;
  static constexpr int kWidth = kPacket;
};
struct HalfPackets {
  using Type = Eigen::internal::packet_traits<float>::half;
  static constexpr int kWidth = sizeof(Type) / sizeof(float);
};

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_PACKET_H_
