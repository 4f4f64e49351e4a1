// Formats figures and tables as Markdown.

#ifndef MANEUVER_TESTS_BENCH_MARKDOWN_H_
#define MANEUVER_TESTS_BENCH_MARKDOWN_H_

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "tests/bench/interleaved.h"
#include "tests/bench/stage_times.h"

namespace maneuver::bench {

// Returns the value with about three digits.
inline std::string Short(double value) {
  return absl::StrFormat("%.*f", value < 9.995 ? 2 : value < 99.95 ? 1 : 0, value);
}
inline std::string Microseconds(const Series& series) {
  return Short(kMicroseconds * Median(series));
}
// Returns "0.21 (0.20 to 0.23)": the median of the rounds' ratios, and the middle half of them.
inline std::string Ratio(const Series& a, const Series& b) {
  const Series ratios = Ratios(a, b);
  return absl::StrFormat("%.3f (%.3f to %.3f)", Median(ratios), Quantile(ratios, 0.25),
                         Quantile(ratios, 0.75));
}
inline std::string Percent(double share) { return absl::StrFormat("%.1f %%", 100.0 * share); }

inline std::string Row(const std::vector<std::string>& cells) {
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}
// Returns a table's header with the first column aligned to the left and the others to the right.
inline std::string Header(const std::vector<std::string>& cells) {
  std::string rule = "|---|";
  for (size_t i = 1; i < cells.size(); ++i) rule += "---:|";
  return absl::StrCat(Row(cells), rule, "\n");
}

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_MARKDOWN_H_
