// Measures the engine on one core: encoding a scene by preset and batch, describing by number of
// actions, classifying.

#include <benchmark/benchmark.h>

#include <numeric>
#include <string>
#include <vector>

#include "model/inference/action_model.h"
#include "model/inference/backbone.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {
namespace {

using inference::Precision;
using inference::SceneEncoding;

// The subject of a measurement: one preset, evaluated in one precision.
struct Subject {
  std::string preset;
  Precision precision;

  std::unique_ptr<inference::InferenceSession> NewSession() const {
    return LoadPreset(preset, precision)->NewSession();
  }
  std::string Name(const char* what) const {
    return "engine/" + std::string(what) + "/" + preset +
           (precision == Precision::kBf16 ? "/bf16" : "/f32");
  }
};

std::vector<SceneEncoding> EncodeFirst(const Subject& subject,
                                       inference::InferenceSession* session) {
  std::vector<SceneEncoding> encodings(1);
  session->Encode(Scenes(subject.preset).first(1), encodings);
  return encodings;
}

// Backbone and p(y|s), from the raster's bytes on.
void Encode(benchmark::State& state, const Subject& subject, int batch) {
  const auto session = subject.NewSession();
  const auto scenes = Scenes(subject.preset).first(static_cast<size_t>(batch));
  std::vector<SceneEncoding> encodings(scenes.size());
  for (auto _ : state) session->Encode(scenes, encodings);
  CountTargets(state, batch);
}

// q(z|y,s), sigma points, decoding and moments.
void Describe(benchmark::State& state, const Subject& subject, int count) {
  const auto session = subject.NewSession();
  const auto encoding = EncodeFirst(subject, session.get());
  std::vector<int> actions(static_cast<size_t>(count));
  std::iota(actions.begin(), actions.end(), 0);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        session->Describe(encoding[0], actions, inference::LatentSource::kPosterior));
  }
  CountTargets(state, 1);
}

void Classify(benchmark::State& state, const Subject& subject) {
  const auto session = subject.NewSession();
  const auto encoding = EncodeFirst(subject, session.get());
  const int waypoints = StoredPreset(subject.preset).manifest.spec().trajectory().waypoints();
  const inference::Trajectory trajectory = inference::Trajectory::Random(waypoints, 2);
  for (auto _ : state) benchmark::DoNotOptimize(session->Classify(encoding[0], trajectory));
  CountTargets(state, 1);
}

}  // namespace

void RegisterEngineBenchmarks() {
  std::vector<Precision> precisions = {Precision::kF32};
  if (inference::ProcessorHasBf16()) precisions.push_back(Precision::kBf16);
  for (const char* preset : kPresets) {
    for (const Precision precision : precisions) {
      const Subject subject{preset, precision};
      for (const int batch : kBatches) {
        benchmark::RegisterBenchmark(
            (subject.Name("encode") + "/batch:" + std::to_string(batch)).c_str(), Encode, subject,
            batch)
            ->Unit(benchmark::kMillisecond);
      }
    }
    const Subject subject{preset, Precision::kF32};
    for (const int actions : {1, 4, 25}) {
      benchmark::RegisterBenchmark(
          (subject.Name("describe") + "/actions:" + std::to_string(actions)).c_str(), Describe,
          subject, actions)
          ->Unit(benchmark::kMillisecond);
    }
    benchmark::RegisterBenchmark(subject.Name("classify").c_str(), Classify, subject)
        ->Unit(benchmark::kMillisecond);
  }
}

}  // namespace maneuver::bench
