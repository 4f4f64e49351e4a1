#include "tests/bench/interleaved.h"

#include <algorithm>
#include <chrono>
#include <cstddef>

namespace maneuver::bench {

double Quantile(Series values, double share) {
  const auto place = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<size_t>(place)];
}

Series Ratios(const Series& a, const Series& b) {
  Series ratios(a.size());
  std::transform(a.begin(), a.end(), b.begin(), ratios.begin(),
                 [](double x, double y) { return x / y; });
  return ratios;
}

Series Sum(const std::vector<Series>& parts) {
  Series sum(parts.front().size(), 0.0);
  for (const Series& part : parts) {
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += part[i];
  }
  return sum;
}

std::vector<Series> MeasureInTurn(const std::vector<std::function<void()>>& things, double seconds,
                                  int least) {
  using Clock = std::chrono::steady_clock;
  for (const auto& thing : things) thing();
  std::vector<Series> series(things.size());
  const Clock::time_point begin = Clock::now();
  Clock::time_point last = begin;
  for (int round = 0;
       round < least || std::chrono::duration<double>(last - begin).count() < seconds; ++round) {
    for (size_t i = 0; i < things.size(); ++i) {
      things[i]();
      const Clock::time_point now = Clock::now();
      series[i].push_back(std::chrono::duration<double>(now - last).count());
      last = now;
    }
  }
  return series;
}

}  // namespace maneuver::bench
