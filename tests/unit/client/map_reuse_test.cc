#include "client/map_reuse.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <list>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "client/error_details.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::map_reuse_test {
namespace {

using ::testing::ElementsAre;

// A server that keeps the latest few registered maps. It answers each scenario with the first x of
// its map in place of an id.
class MapReuseTest : public ::testing::Test {
 protected:
  MapReuseTest() {
    server_.on_register_map = [this](const v1::RegisterMapRequest& request,
                                     v1::RegisterMapResponse* response) {
      const std::lock_guard lock(mutex_);
      ++registrations_;
      if (!refusal_.ok()) return refusal_;
      response->set_map_id(std::to_string(++last_id_));
      held_.push_back({response->map_id(), request.map_features(0).x(0)});
      if (held_.size() > max_held_) held_.pop_front();
      return grpc::Status::OK;
    };
    server_.on_predict = [this](auto*, const v1::PredictRequest& request,
                                v1::PredictResponse* response) {
      const std::lock_guard lock(mutex_);
      for (const v1::Scenario& scenario : request.scenarios()) {
        double x = 0.0;
        if (!scenario.map_features().empty()) {
          x = scenario.map_features(0).x(0);
          ++sent_whole_;
        } else if (!scenario.map_id().empty()) {
          const auto map = std::ranges::find(held_, scenario.map_id(), &HeldMap::id);
          if (map == held_.end()) return NotRegistered();
          x = map->x;
        }
        response->add_predictions()->set_scenario_id(std::to_string(static_cast<int>(x)));
      }
      return grpc::Status::OK;
    };
    ClientOptions options;
    options.address = server_.address();
    client_ = *Client::Connect(options);
  }

  static grpc::Status NotRegistered() { return Error("MAP_NOT_REGISTERED"); }
  static grpc::Status Error(const std::string& reason) {
    v1::ErrorInfo info;
    info.set_reason(reason);
    v1::Status status;
    status.set_code(grpc::StatusCode::FAILED_PRECONDITION);
    auto* detail = status.add_details();
    detail->set_type_url("type.googleapis.com/google.rpc.ErrorInfo");
    detail->set_value(info.SerializeAsString());
    return {grpc::StatusCode::FAILED_PRECONDITION, "no", status.SerializeAsString()};
  }

  // Returns a scene for each x, on a map of one lane that begins there; 0: without a map.
  static v1::PredictRequest Request(const std::vector<double>& xs) {
    v1::PredictRequest request;
    for (const double x : xs) {
      v1::Scenario* scenario = request.add_scenarios();
      if (x == 0.0) continue;
      v1::MapFeature* lane = scenario->add_map_features();
      lane->set_type(v1::MAP_FEATURE_TYPE_LANE_CENTERLINE);
      lane->add_x(x);
      lane->add_y(1.0);
    }
    return request;
  }
  static std::vector<std::string> Answered(const absl::StatusOr<v1::PredictResponse>& response) {
    std::vector<std::string> answered;
    if (!response.ok()) return {response.status().ToString()};
    for (const auto& prediction : response->predictions()) {
      answered.push_back(prediction.scenario_id());
    }
    return answered;
  }

  struct HeldMap {
    std::string id;
    double x;
  };

  std::mutex mutex_;  // guards what follows
  std::list<HeldMap> held_;
  size_t max_held_ = 10;
  int last_id_ = 0;
  int registrations_ = 0;
  int sent_whole_ = 0;
  grpc::Status refusal_ = grpc::Status::OK;

  TestServer server_;
  std::unique_ptr<Client> client_;
};

TEST_F(MapReuseTest, SendsAMapOnce) {
  MapReuse maps(*client_);
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(Answered(maps.Predict(Request({5.0, 0.0, 6.0, 5.0}))),
                ElementsAre("5", "0", "6", "5"));
  }
  EXPECT_EQ(registrations_, 2);
  EXPECT_EQ(sent_whole_, 0);
}

TEST_F(MapReuseTest, DistinguishesMapsWhoseLanesDeclareDifferentLinks) {
  MapReuse maps(*client_);
  const auto declare = [&](auto add_id) {
    v1::PredictRequest request = Request({5.0});
    add_id(request.mutable_scenarios(0)->mutable_map_features(0));
    EXPECT_THAT(Answered(maps.Predict(request)), ElementsAre("5"));
  };
  declare([](v1::MapFeature*) {});
  declare([](v1::MapFeature* lane) { lane->add_successor_ids(3); });
  declare([](v1::MapFeature* lane) { lane->add_left_neighbor_ids(3); });
  declare([](v1::MapFeature* lane) { lane->add_right_neighbor_ids(3); });
  EXPECT_EQ(registrations_, 4);
}

TEST_F(MapReuseTest, RegistersAMapAgainThatTheServerLost) {
  MapReuse maps(*client_);
  maps.Predict(Request({5.0, 6.0})).IgnoreError();
  held_.clear();  // as a restart would
  EXPECT_THAT(Answered(maps.Predict(Request({5.0, 6.0}))), ElementsAre("5", "6"));
  EXPECT_EQ(registrations_, 4);
  EXPECT_EQ(sent_whole_, 0);
}

TEST_F(MapReuseTest, SendsMapsThatTheServerHasNoRoomForWithTheRequest) {
  max_held_ = 1;
  MapReuse maps(*client_);
  EXPECT_THAT(Answered(maps.Predict(Request({5.0, 6.0}))), ElementsAre("5", "6"));
  EXPECT_EQ(sent_whole_, 2);
}

TEST_F(MapReuseTest, SendsARefusedMapWithTheRequest) {
  MapReuse maps(*client_);
  for (const grpc::Status& refusal :
       {grpc::Status(grpc::StatusCode::UNIMPLEMENTED, ""),
        grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, ""), Error("MAP_TOO_LARGE")}) {
    refusal_ = refusal;
    sent_whole_ = 0;
    EXPECT_THAT(Answered(maps.Predict(Request({5.0}))), ElementsAre("5"));
    EXPECT_EQ(sent_whole_, 1);
  }
  refusal_ = {grpc::StatusCode::PERMISSION_DENIED, "no"};
  EXPECT_TRUE(absl::IsPermissionDenied(maps.Predict(Request({5.0})).status()));
}

TEST_F(MapReuseTest, ReturnsOtherErrorsToTheCaller) {
  MapReuse maps(*client_);
  v1::PredictRequest own_id = Request({0.0});
  own_id.mutable_scenarios(0)->set_map_id("nobody's");
  EXPECT_EQ(ErrorDetailsOf(maps.Predict(own_id).status()).reason, "MAP_NOT_REGISTERED");
  EXPECT_EQ(registrations_, 0);
}

TEST_F(MapReuseTest, RemembersTheMostRecentlyUsedMaps) {
  MapReuse maps(*client_, 2);
  for (const double x : {5.0, 6.0, 5.0, 7.0, 5.0}) maps.Predict(Request({x})).IgnoreError();
  EXPECT_EQ(registrations_, 3);
  maps.Predict(Request({6.0})).IgnoreError();
  EXPECT_EQ(registrations_, 4);
}

TEST_F(MapReuseTest, NamesMapsForStreams) {
  MapReuse maps(*client_);
  v1::PredictRequest request = Request({5.0, 0.0});
  ASSERT_TRUE(maps.NameMaps(request.mutable_scenarios()).ok());
  EXPECT_EQ(request.scenarios(0).map_id(), "1");
  EXPECT_TRUE(request.scenarios(0).map_features().empty());
  EXPECT_EQ(request.scenarios(1).map_id(), "");
  maps.Forget();
  request = Request({5.0});
  ASSERT_TRUE(maps.NameMaps(request.mutable_scenarios()).ok());
  EXPECT_EQ(request.scenarios(0).map_id(), "2");

  maps.Forget();
  refusal_ = {grpc::StatusCode::PERMISSION_DENIED, "no"};
  request = Request({5.0});
  EXPECT_FALSE(maps.NameMaps(request.mutable_scenarios()).ok());
  EXPECT_EQ(request.scenarios(0).map_features(0).x(0), 5.0);
}

// Each call reaches the next of several servers, which have maps of their own.
TEST_F(MapReuseTest, EveryServerBehindABalancerSoonHasTheMap) {
  for (const size_t servers : {2, 3, 5, 7}) {
    std::vector<std::set<std::string>> held(servers);
    size_t calls = 0;
    int missing = 0;
    int whole = 0;
    server_.on_register_map = [&](const v1::RegisterMapRequest& request,
                                  v1::RegisterMapResponse* response) {
      response->set_map_id(std::to_string(request.map_features(0).x(0)));
      held[calls++ % servers].insert(response->map_id());
      return grpc::Status::OK;
    };
    server_.on_predict = [&](auto*, const v1::PredictRequest& request, v1::PredictResponse*) {
      const std::set<std::string>& here = held[calls++ % servers];
      const std::string& map = request.scenarios(0).map_id();
      if (map.empty()) {
        ++whole;
      } else if (!here.contains(map)) {
        ++missing;
        return NotRegistered();
      }
      return grpc::Status::OK;
    };
    MapReuse maps(*client_);
    for (int i = 0; i < 200; ++i) ASSERT_TRUE(maps.Predict(Request({5.0})).ok());
    missing = whole = 0;
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(maps.Predict(Request({5.0})).ok());
    EXPECT_EQ(missing + whole, 0) << servers << " servers";
  }
}

TEST_F(MapReuseTest, ManyThreadsShareTheirMaps) {
  MapReuse maps(*client_, 2);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&maps, t] {
      for (int i = 0; i < 20; ++i) {
        const double x = 5.0 + (t + i) % 3;
        EXPECT_THAT(Answered(maps.Predict(Request({x}))),
                    ElementsAre(std::to_string(static_cast<int>(x))));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
}

}  // namespace
}  // namespace maneuver::client::map_reuse_test
