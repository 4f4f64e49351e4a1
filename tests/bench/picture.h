// Pictures of measurements, as SVG.

#ifndef MANEUVER_TESTS_BENCH_PICTURE_H_
#define MANEUVER_TESTS_BENCH_PICTURE_H_

#include <string>
#include <vector>

namespace maneuver::bench {

struct Curve {
  std::string name;
  std::vector<double> y;
};

// y over x, both from zero on; the lines' names stand at their ends.
//   logarithmic_x: x is drawn by its logarithm, and has to be positive.
struct Chart {
  std::string title;
  std::string x_title;
  std::string y_title;
  std::vector<double> x;
  std::vector<Curve> curves;
  bool logarithmic_x = false;
};
std::string DrawChart(const Chart& chart);

// One bar for each column of `values`, cut into parts.
//   parts: names of the rows;  values: [parts][bars]
std::string DrawBars(const std::string& title, const std::string& unit,
                     const std::vector<std::string>& bars, const std::vector<std::string>& parts,
                     const std::vector<std::vector<double>>& values);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_PICTURE_H_
