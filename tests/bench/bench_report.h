// Writes the report of maneuver-bench: tables and pictures of one run.

#ifndef MANEUVER_TESTS_BENCH_BENCH_REPORT_H_
#define MANEUVER_TESTS_BENCH_BENCH_REPORT_H_

#include <filesystem>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "maneuver/v1/scenario.pb.h"
#include "tests/bench/bench_model.h"

namespace maneuver::bench {

// At least one scene of one kind, each with kLargestBatch targets.
struct SceneSet {
  std::string name;  // "recorded scenes"
  std::vector<v1::Scenario> scenes;
};

struct ReportOptions {
  std::vector<BenchModel> models;  // the first is looked at most closely
  std::vector<SceneSet> scenes;    // the curves are of the first
  MakePeer libtorch;               // none if empty
  double seconds = 10.0;           // of each measurement
  int rounds = 9;                  // at least so many of each
  int most_targets = 1'000;        // of a request
  size_t yardstick_bytes = size_t{256} << 20;
  std::filesystem::path file;      // Markdown
  std::filesystem::path pictures;  // folder of the pictures
};

// Measures and writes the report. Errors: those of writing files.
absl::Status WriteReport(const ReportOptions& options);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_BENCH_REPORT_H_
