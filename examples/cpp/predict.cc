// Asks a server what the target of a scene will do: predict SCENE.json [HOST:PORT]
#include <google/protobuf/util/json_util.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>

#include "client/client.h"
#include "client/error_details.h"

namespace client = maneuver::client;
namespace v1 = maneuver::v1;

int main(int argc, char** argv) {
  if (argc < 2) return std::cerr << "predict SCENE.json [HOST:PORT]\n", 2;
  std::ostringstream json;
  json << std::ifstream(argv[1]).rdbuf();
  v1::PredictRequest request;
  const auto parsed =
      google::protobuf::util::JsonStringToMessage(json.str(), request.add_scenarios());
  if (!parsed.ok()) return std::cerr << argv[1] << ": " << parsed.message() << "\n", 1;
  request.mutable_query()->set_top_k(3);  // the three most probable actions

  const auto server = client::Client::Connect({.address = argc > 2 ? argv[2] : "127.0.0.1:8470"});
  if (!server.ok()) return std::cerr << server.status().message() << "\n", 1;
  const auto answer = (*server)->Predict(request, {.timeout = absl::Seconds(5)});
  if (!answer.ok()) {
    std::cerr << answer.status().message() << "\n";
    for (const auto& wrong : client::ErrorDetailsOf(answer.status()).field_violations) {
      std::cerr << wrong.field << ": " << wrong.description << "\n";
    }
    return 1;
  }
  // A scene or a target of a batch fails alone.
  const v1::ScenarioPrediction& scene = answer->predictions(0);
  if (scene.has_error()) return std::cerr << scene.error().message() << "\n", 1;
  for (const v1::TargetPrediction& target : scene.targets()) {
    if (target.has_error()) return std::cerr << target.error().message() << "\n", 1;
    std::cout << "vehicle " << target.target_id() << ", by " << answer->model_version() << "\n";
    for (const v1::ActionDistribution& action : target.distributions()) {
      const v1::Trajectory& mean = action.mean_trajectory();  // world frame, metres
      const int last = mean.x_size() - 1;
      std::printf("action %d  probability %.3f  after %.1f s at (%.1f, %.1f)\n", action.action_id(),
                  action.probability(), answer->waypoint_times(last), mean.x(last), mean.y(last));
    }
  }
}
