// Lets the engine take turns with another program that evaluates the same network on the same
// scenes.

#ifndef MANEUVER_TESTS_BENCH_TURNS_H_
#define MANEUVER_TESTS_BENCH_TURNS_H_

#include <filesystem>
#include <iosfwd>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {

// Writes to `file`, as 32-bit floats one after the other, what another engine needs and has to
// answer: the inputs of the exported networks (model/onnx/onnx_export.h) that p(y|s) needs, then
// this engine's p(y|s), [N, K]. Says the sizes in one line of JSON on `out`:
//   {"model": ..., "precision": "f32", "scenes": N, "actions": K,
//    "inputs": [{"name": "raster", "sizes": [N, C, H, W]}, {"name": "motion", "sizes": [N, 4]}]}
// Then answers each line "encode R" on `in` with the seconds of processor time that R evaluations
// of the networks up to p(y|s) of all N took, on one thread. This engine's time includes the
// comparison of actions with lane paths, which the other engine gets as an input. Answers each line
// "compare R" with the seconds of R such comparisons alone, 0 for a model without. Ends with `in`.
absl::Status TakeTurns(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                       const std::filesystem::path& file, std::istream& in, std::ostream& out);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_TURNS_H_
