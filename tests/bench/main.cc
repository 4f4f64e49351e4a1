// maneuver-bench: google-benchmark's options, such as --benchmark_filter=encode.

#include <benchmark/benchmark.h>

#include "tests/bench/bench_model.h"

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  maneuver::bench::RegisterEngineBenchmarks();
  maneuver::bench::RegisterMapBenchmarks();
#ifdef MANEUVER_TRAINER
  maneuver::bench::RegisterLibTorchBenchmarks();
#endif
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
