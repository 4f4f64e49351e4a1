// Draws measurements as SVG pictures.

#ifndef MANEUVER_TESTS_BENCH_PICTURE_H_
#define MANEUVER_TESTS_BENCH_PICTURE_H_

#include <string>
#include <vector>

namespace maneuver::bench {

struct Curve {
  std::string name;
  std::vector<double> y;
};

// A chart of y over x, both from zero on, with the lines' names at their ends.
//   logarithmic_x: draws x by its logarithm; x must then be positive
struct Chart {
  std::string title;
  std::string x_title;
  std::string y_title;
  std::vector<double> x;
  std::vector<Curve> curves;
  bool logarithmic_x = false;
};
std::string DrawChart(const Chart& chart);

// Draws one bar for each column of `values`, divided into parts.
//   parts: names of the rows;  values: [parts][bars]
std::string DrawBars(const std::string& title, const std::string& unit,
                     const std::vector<std::string>& bars, const std::vector<std::string>& parts,
                     const std::vector<std::vector<double>>& values);

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_PICTURE_H_
