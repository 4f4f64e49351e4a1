#include "tests/bench/turns.h"

#include <fstream>
#include <istream>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "model/artifact/backbone_layers.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/interleaved.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {
namespace {

// [H, W, C] bytes to [C, H, W] of 0 to 1.
void AppendChannelsFirst(const uint8_t* raster, const artifact::GridSize& size,
                         std::vector<float>* values) {
  const int cells = size.height * size.width;
  for (int c = 0; c < size.channels; ++c) {
    for (int cell = 0; cell < cells; ++cell) {
      values->push_back(static_cast<float>(raster[cell * size.channels + c]) / 255.0f);
    }
  }
}

std::vector<float> InputsAndAnswers(const Pipeline& pipeline, const artifact::GridSize& size) {
  std::vector<float> values;
  for (const auto& scene : pipeline.scenes()) AppendChannelsFirst(scene.raster, size, &values);
  for (const auto& scene : pipeline.scenes()) {
    values.insert(values.end(), scene.motion.begin(), scene.motion.end());
  }
  for (const auto& encoding : pipeline.encodings()) {
    for (const double p : encoding.probabilities) values.push_back(static_cast<float>(p));
  }
  return values;
}

}  // namespace

absl::Status TakeTurns(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                       const std::filesystem::path& file, std::istream& in, std::ostream& out) {
  const v1::ModelSpec& spec = model.model->spec();
  const artifact::GridSize size = artifact::RasterGrid(spec.raster());
  Pipeline pipeline(model, {RequestFor({scenes.front()}, 1)}, 1);
  const std::vector<float> values = InputsAndAnswers(pipeline, size);
  std::ofstream written(file, std::ios::binary);
  written.write(reinterpret_cast<const char*>(values.data()),
                static_cast<std::streamsize>(sizeof(float) * values.size()));
  written.close();
  if (!written) return absl::UnavailableError(absl::StrCat("cannot write ", file.string()));
  const nlohmann::ordered_json sizes = {{"model", model.name},
                                        {"precision", model.model->precision()},
                                        {"scenes", pipeline.targets()},
                                        {"channels", size.channels},
                                        {"height", size.height},
                                        {"width", size.width},
                                        {"motion", spec.target_motion()},
                                        {"actions", spec.actions()}};
  out << sizes.dump() << std::endl;

  const auto session = model.model->NewSession();
  std::vector<inference::SceneEncoding> encodings(pipeline.scenes().size());
  std::string word;
  for (int repeats = 0; in >> word >> repeats && word == "encode";) {
    const double begin = ThreadSeconds();
    for (int i = 0; i < repeats; ++i) session->Encode(pipeline.scenes(), encodings);
    out << ThreadSeconds() - begin << std::endl;
  }
  return absl::OkStatus();
}

}  // namespace maneuver::bench
