#ifndef MANEUVER_TESTS_INTEGRATION_TRAINED_SERVER_H_
#define MANEUVER_TESTS_INTEGRATION_TRAINED_SERVER_H_

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "tests/integration/server_process.h"

namespace maneuver::integration {

// TrainingSettings as JSON for a model that trains in seconds: 12 actions, 10 waypoints over 4 s.
extern const char kTinySettings[];
// The same for a small model of the default preset, `lanes`.
extern const char kTinyLanesSettings[];

// Writes a dataset folder with recordings of the synthetic town. Appends them to *kept unless that
// is nullptr.
void WriteTown(const std::filesystem::path& folder, uint64_t seed, int recordings,
               std::vector<v1::Scenario>* kept);

// A data folder whose server holds datasets/town and datasets/unseen (other recordings of the town)
// and models/tiny, trained on the first through the Train RPC by the `maneuver` command.
class TrainedServer {
 public:
  //   flags: added to the server's command
  //   settings: of the training
  explicit TrainedServer(std::vector<std::string> flags = {}, const char* settings = kTinySettings);

  const std::filesystem::path& folder() const { return folder_.path(); }
  std::filesystem::path data_dir() const { return folder_.path() / "data"; }
  ServerProcess& server() { return *server_; }
  // Replaces the process by another one over the same data folder.
  void Restart();
  // Returns the recordings of datasets/unseen, with prediction time and targets.
  const std::vector<v1::Scenario>& unseen() const { return unseen_; }
  // Returns a file with the TrainingSettings, as JSON.
  std::filesystem::path settings() const { return folder_.path() / "tiny.json"; }

 private:
  const std::vector<std::string> flags_;
  TemporaryFolder folder_;
  std::unique_ptr<ServerProcess> server_;
  std::vector<v1::Scenario> unseen_;
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_TRAINED_SERVER_H_
