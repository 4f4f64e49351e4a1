#include "tests/bench/interleaved.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cstddef>

namespace maneuver::bench {

double ThreadSeconds() {
  timespec time;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

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
  const auto passed = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  for (int round = 0; round < least || passed() < seconds; ++round) {
    double last = ThreadSeconds();
    for (size_t i = 0; i < things.size(); ++i) {
      things[i]();
      const double now = ThreadSeconds();
      series[i].push_back(now - last);
      last = now;
    }
  }
  return series;
}

}  // namespace maneuver::bench
