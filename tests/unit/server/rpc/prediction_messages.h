// A scene and a model for tests of the way from a prediction request to its answer.

#ifndef MANEUVER_TESTS_UNIT_SERVER_RPC_PREDICTION_MESSAGES_H_
#define MANEUVER_TESTS_UNIT_SERVER_RPC_PREDICTION_MESSAGES_H_

#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include <string>

#include "absl/status/status.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/status.pb.h"
#include "server/errors/error_details.h"

namespace maneuver::rpc {

template <typename Message>
Message FromText(const std::string& text) {
  Message message;
  EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(text, &message));
  return message;
}

inline v1::ModelSpec Spec() {
  return FromText<v1::ModelSpec>(R"(
    raster { height: 32 width: 32 meters_per_pixel: 1 target_position: 0.5 history_frames: 2
             frame_interval { nanos: 100000000 } }
    trajectory { waypoints: 2 waypoint_interval { seconds: 1 } }
    actions: 3)");
}

// Two cars: 1 stands at (10, 20) and looks along +y, 2 has no state now.
inline v1::Scenario TwoCars() {
  return FromText<v1::Scenario>(R"(
    scenario_id: "scene" prediction_time: 5 target_ids: [ 1, 2 ]
    agents { id: 1 type: AGENT_TYPE_VEHICLE length: 4 width: 2
             states { time: 5 x: 10 y: 20 heading: 1.5707963 } }
    agents { id: 2 type: AGENT_TYPE_VEHICLE length: 4 width: 2 states { time: 3 } })");
}

// Returns the first field that an error names.
inline std::string FirstField(const absl::Status& status) {
  const v1::Status proto = errors::ToProto(status);
  for (const auto& any : proto.details()) {
    v1::BadRequest detail;
    if (any.type_url() == "type.googleapis.com/google.rpc.BadRequest" &&
        detail.ParseFromString(any.value())) {
      return detail.field_violations(0).field();
    }
  }
  return "";
}

}  // namespace maneuver::rpc

#endif  // MANEUVER_TESTS_UNIT_SERVER_RPC_PREDICTION_MESSAGES_H_
