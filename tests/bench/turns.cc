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

// To [C, H, W] of 0 to 1.
void AppendChannelsFirst(const scene::Raster& raster, std::vector<float>* values) {
  for (int channel = 0; channel < raster.channels(); ++channel) {
    for (int row = 0; row < raster.height(); ++row) {
      const uint8_t* const pixels = raster.Row(channel, row);
      for (int column = 0; column < raster.width(); ++column) {
        values->push_back(static_cast<float>(pixels[column]) / 255.0f);
      }
    }
  }
}

std::vector<float> InputsAndAnswers(const Pipeline& pipeline) {
  std::vector<float> values;
  for (const auto& scene : pipeline.scenes()) AppendChannelsFirst(*scene.raster, &values);
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
  const std::vector<float> values = InputsAndAnswers(pipeline);
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
