// The engine's turn beside another program that evaluates the same network on the same scenes.

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
// answer: the rasters divided by 255, [N, C, H, W]; the motion inputs, [N, 4]; this engine's
// p(y|s), [N, K]. Says the sizes in one line of JSON on `out`:
//   {"model": ..., "precision": "f32", "scenes": N, "channels": C, "height": H, "width": W,
//    "motion": true, "actions": K}
// Then answers each line "encode R" on `in` with the seconds of processor time that R evaluations
// of backbone and p(y|s) of all N took, on one thread from the rasters' bytes on; ends with `in`.
absl::Status TakeTurns(const BenchModel& model, const std::vector<v1::Scenario>& scenes,
                       const std::filesystem::path& file, std::istream& in, std::ostream& out);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_TURNS_H_
