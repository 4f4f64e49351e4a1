#include "tests/bench/answer_digest.h"

#include "model/files/digest.h"
#include "tests/bench/bench_scenes.h"
#include "tests/bench/pipeline.h"

namespace maneuver::bench {
namespace {

constexpr int kActions = 4;

void AddAnswer(const BenchModel& model, const v1::Scenario& scene, files::Sha256* digest) {
  const Pipeline pipeline(model, {RequestFor({scene}, kActions)}, kActions);
  digest->Update(pipeline.responses().front());
}

}  // namespace

std::string AnswerDigest(const BenchModel& model, const std::vector<v1::Scenario>& scenes) {
  files::Sha256 digest;
  for (v1::Scenario scene : scenes) {
    AddAnswer(model, scene, &digest);
    scene.mutable_target_ids()->Truncate(1);
    AddAnswer(model, scene, &digest);
  }
  return digest.Finish();
}

}  // namespace maneuver::bench
