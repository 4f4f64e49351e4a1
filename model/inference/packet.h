#ifndef MANEUVER_MODEL_INFERENCE_PACKET_H_
#define MANEUVER_MODEL_INFERENCE_PACKET_H_

#include <Eigen/Core>

namespace maneuver::inference {

// Eigen's widest vector of floats for this processor: 8 with AVX2, 16 with AVX-512.
using Packet = Eigen::internal::packet_traits<float>::type;
inline constexpr int kPacket = Eigen::internal::packet_traits<float>::size;

}  // namespace maneuver::inference

#endif  // MANEUVER_MODEL_INFERENCE_PACKET_H_
