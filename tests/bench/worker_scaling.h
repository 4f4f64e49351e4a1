// Measures how much more several workers do than one: the scheduler and its threads in process,
// with neither gRPC nor callers, which would need the same cores.

#ifndef MANEUVER_TESTS_BENCH_WORKER_SCALING_H_
#define MANEUVER_TESTS_BENCH_WORKER_SCALING_H_

#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"
#include "tests/bench/interleaved.h"

namespace maneuver::bench {

struct WorkerSpeed {
  int workers = 1;
  Series targets_per_second;  // by the clock, one for each round
};

// Measures one worker, two, and so on up to the number of processors that the process may use, in
// turn.
//   scenes: each is a call of its own, for all of its targets
std::vector<WorkerSpeed> MeasureWorkers(const BenchModel& model,
                                        const std::vector<v1::Scenario>& scenes, double seconds,
                                        int least_rounds);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_WORKER_SCALING_H_
