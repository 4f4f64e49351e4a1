// The safetensors format, as far as a model's weights need it: 32-bit floats.
//
//   u64 little-endian   length of the header, bytes
//   header              JSON object, name -> {"dtype": "F32", "shape": [..],
//                       "data_offsets": [b, e]}, and an optional "__metadata__" object, which is
//                       ignored
//   data                little-endian values, row-major; offsets count from its first byte
//
// For example one tensor {"a": [1.0]} is 38 00 00 00 00 00 00 00, then the 56 bytes
// `{"a":{"data_offsets":[0,4],"dtype":"F32","shape":[1]}}  `, then 00 00 80 3f.

#ifndef MANEUVER_MODEL_ARTIFACT_SAFETENSORS_H_
#define MANEUVER_MODEL_ARTIFACT_SAFETENSORS_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "model/artifact/tensor.h"

namespace maneuver::artifact {

// Returns the file's bytes. Equal tensors give equal bytes. Tensor shapes must match their values.
std::string SerializeSafetensors(const TensorMap& tensors);

// Returns the tensors of a file. DATA_LOSS with the reason if the header is longer than the file or
// 16 MiB, is not JSON, names a tensor twice, names another type than F32, or if the tensors do not
// cover the data exactly once.
absl::StatusOr<TensorMap> ParseSafetensors(std::string_view bytes);

}  // namespace maneuver::artifact

#endif  // MANEUVER_MODEL_ARTIFACT_SAFETENSORS_H_
