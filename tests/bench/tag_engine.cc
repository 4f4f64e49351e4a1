// Measures what the engine does for tags, with nothing around it: recordings are in memory, their
// maps are indexed and their windows are known. Prints windows a second, by the clock and by the processor's time.
//
//   tag_engine MODEL DATASET [THREADS [SECONDS]]

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <memory>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "model/data/dataset_folder.h"
#include "model/data/example_index.h"
#include "model/inference/action_model.h"
#include "model/machine/usable_cores.h"
#include "model/scene/road_map.h"
#include "model/scene/scene_reader.h"
#include "model/tags/tag_datasets.h"

namespace maneuver::bench {
namespace {

constexpr size_t kBatch = 8;      // as in the tagger
constexpr int kRecordings = 200;  // at most, so that they fit in memory

struct Work {
  std::shared_ptr<const inference::ActionModel> model;
  std::vector<v1::Scenario> recordings;
  std::vector<scene::RoadMap> maps;     // of the recordings
  std::vector<data::Example> examples;  // of all recordings
};

void Ask(const Work& work, std::atomic<size_t>& next, const std::atomic<bool>& stop,
         std::atomic<int64_t>& done) {
  const auto session = work.model->NewSession();
  scene::SceneReader reader(work.model->spec());
  std::vector<scene::SceneInputs> inputs(kBatch, reader.NewInputs());
  std::vector<inference::SceneEncoding> encodings(kBatch);
  while (!stop) {
    const size_t begin = next.fetch_add(kBatch) % work.examples.size();
    const auto batch =
        std::span(work.examples).subspan(begin, std::min(kBatch, work.examples.size() - begin));
    std::vector<inference::SceneInputsView> scenes;
    for (size_t i = 0; i < batch.size(); ++i) {
      const auto recording = static_cast<size_t>(batch[i].recording);
      reader.Read(work.recordings[recording], work.maps[recording], batch[i].time,
                  batch[i].target_id, batch[i].X_WT, &inputs[i]);
      scenes.push_back(inference::ViewOf(inputs[i]));
    }
    session->Encode(scenes, std::span(encodings).first(batch.size()));
    for (size_t i = 0; i < batch.size(); ++i) {
      inference::Trajectory driven(static_cast<Eigen::Index>(batch[i].trajectory.size() / 2), 2);
      std::ranges::copy(batch[i].trajectory, driven.data());
      session->Classify(encodings[i], driven);
      int likeliest = 0;
      encodings[i].probabilities.maxCoeff(&likeliest);
      session->MeanTrajectories(encodings[i], std::array{likeliest},
                                inference::LatentSource::kPosterior);
    }
    done += static_cast<int64_t>(batch.size());
  }
}

int Main(int argc, char** argv) {
  if (argc < 3) {
    std::cerr << "tag_engine MODEL DATASET [THREADS [SECONDS]]\n";
    return 2;
  }
  Work work;
  const auto model =
      inference::ActionModel::Load(argv[1], {.precision = inference::Precision::kF32});
  if (!model.ok()) return std::cerr << model.status() << "\n", 1;
  work.model = *model;
  const absl::Status read =
      data::ForEachScenario(argv[2], data::OnDamage::kStop, [&](v1::Scenario&& recording) {
        work.recordings.push_back(std::move(recording));
        return work.recordings.size() < kRecordings;
      });
  if (!read.ok()) return std::cerr << read << "\n", 1;
  for (size_t i = 0; i < work.recordings.size(); ++i) {
    work.maps.push_back(scene::RoadMap::Over(work.recordings[i].map_features()));
    for (data::Example& example :
         data::EnumerateExamples(work.recordings[i], static_cast<int>(i), work.model->spec(),
                                 tags::TaggingExamples(work.model->manifest(), std::nullopt))) {
      work.examples.push_back(std::move(example));
    }
  }
  if (work.examples.empty()) return std::cerr << "there are no windows\n", 1;
  const int threads = argc > 3 ? std::atoi(argv[3]) : machine::UsableCores();
  const double seconds = argc > 4 ? std::atof(argv[4]) : 10.0;
  std::atomic<size_t> next = 0;
  std::atomic<bool> stop = false;
  std::atomic<int64_t> done = 0;
  const auto start = std::chrono::steady_clock::now();
  const std::clock_t used_before = std::clock();
  {
    std::vector<std::jthread> workers;
    for (int i = 0; i < threads; ++i) workers.emplace_back([&] { Ask(work, next, stop, done); });
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    stop = true;
  }
  const double passed =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const double used = static_cast<double>(std::clock() - used_before) / CLOCKS_PER_SEC;
  std::cout << static_cast<double>(done) / passed << " " << static_cast<double>(done) / used
            << "\n";
  return 0;
}

}  // namespace
}  // namespace maneuver::bench

int main(int argc, char** argv) { return maneuver::bench::Main(argc, argv); }
