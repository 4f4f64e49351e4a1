#include "server/rpc/blocking_call.h"

#include <gtest/gtest.h>

#include "maneuver/v1/prediction_service.pb.h"

namespace maneuver::rpc::blocking_call_test {
namespace {

TEST(BlockingCallTest, AMapThatWaitsCountsAsItsBytes) {
  v1::RegisterMapRequest request;
  for (int i = 0; i < 100; ++i) {
    v1::MapFeature& lane = *request.add_map_features();
    for (int j = 0; j < 50; ++j) {
      lane.add_x(1.5);
      lane.add_y(-2.5);
    }
  }
  EXPECT_EQ(WaitingBytes(request), static_cast<int64_t>(request.ByteSizeLong()));
}

TEST(BlockingCallTest, AMapOfEmptyFeaturesThatWaitsCountsAsWhatItTakes) {
  v1::RegisterMapRequest request;
  for (int i = 0; i < 100'000; ++i) request.add_map_features();
  EXPECT_LT(request.ByteSizeLong(), 250'000U);
  // An empty feature is an object all the same, and has a pointer to it.
  EXPECT_GE(4 * WaitingBytes(request), 100'000 * int64_t{sizeof(v1::MapFeature) + sizeof(void*)});
}

}  // namespace
}  // namespace maneuver::rpc::blocking_call_test
