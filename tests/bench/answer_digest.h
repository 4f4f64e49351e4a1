// A digest of many answers, for changes that must not change a bit of them.

#ifndef MANEUVER_TESTS_BENCH_ANSWER_DIGEST_H_
#define MANEUVER_TESTS_BENCH_ANSWER_DIGEST_H_

#include <string>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {

// Returns the SHA-256 of the serialised responses to requests for each scene: for all of its
// targets, and for the first one alone.
//   scenes: each with 1 to kLargestBatch targets
std::string AnswerDigest(const BenchModel& model, const std::vector<v1::Scenario>& scenes);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_ANSWER_DIGEST_H_
