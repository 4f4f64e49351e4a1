// A tiny model with valid but meaningless weights.

#ifndef MANEUVER_TESTS_UNIT_MODEL_ARTIFACT_TINY_MODEL_H_
#define MANEUVER_TESTS_UNIT_MODEL_ARTIFACT_TINY_MODEL_H_

#include <google/protobuf/text_format.h>

#include <cstdint>

#include "model/artifact/model_folder.h"
#include "model/artifact/model_spec.h"

namespace maneuver::artifact {

inline v1::ModelSpec TinySpec() {
  v1::ModelSpec spec;
  google::protobuf::TextFormat::ParseFromString(
      R"pb(
        raster {
          height: 16
          width: 20
          meters_per_pixel: 2
          target_position: 0.3
          history_frames: 2
          frame_interval { seconds: 1 }
        }
        backbone {
          convolutions { channels: 4 stride: 2 }
          convolutions { channels: 6 stride: 1 }
          features: 5
        }
        trajectory {
          waypoints: 3
          waypoint_interval { nanos: 100000000 }
        }
        actions: 3
        latent_dimensions: 2
        action_predictor { hidden: [ 7 ] }
        trajectory_encoder { hidden: [ 8, 9 ] }
        decoder { hidden: [ 10 ] }
        scenario_encoder { hidden: [ 11 ] }
        decoder_stddev: 1
      )pb",
      &spec);
  return spec;
}

inline StoredModel TinyModel() {
  StoredModel model;
  *model.manifest.mutable_spec() = TinySpec();
  float value = 0.0f;
  for (const auto& [name, shape] : TensorShapes(TinySpec())) {
    Tensor& tensor = model.weights[name];
    tensor.shape = shape;
    int64_t count = 1;
    for (const int64_t size : shape) count *= size;
    for (int64_t i = 0; i < count; ++i) tensor.values.push_back(value += 0.25f);
  }
  for (size_t i = 1; i < model.weights["decoder.covariance"].values.size(); i += 3) {
    model.weights["decoder.covariance"].values[i] = 0.0f;  // no xy
  }
  return model;
}

}  // namespace maneuver::artifact

#endif  // MANEUVER_TESTS_UNIT_MODEL_ARTIFACT_TINY_MODEL_H_
