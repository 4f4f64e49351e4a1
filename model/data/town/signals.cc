#include "model/data/town/signals.h"

#include <cmath>

namespace maneuver::data::town {
namespace {

// Returns the seconds since the group last turned green, within [0, cycle).
double SinceGreen(const SignalPlan& plan, int group, double time) {
  double start = plan.offset;
  for (int g = 0; g < group; ++g) start += plan.green[g] + plan.yellow + plan.all_red;
  const double cycle = plan.Cycle();
  const double phase = std::fmod(time - start, cycle);
  return phase < 0.0 ? phase + cycle : phase;
}

}  // namespace

double SignalPlan::Cycle() const {
  double sum = 0.0;
  for (const double seconds : green) sum += seconds + yellow + all_red;
  return sum;
}

Light SignalPlan::At(int group, double time) const {
  const double since = SinceGreen(*this, group, time);
  if (since < green[group]) return Light::kGreen;
  return since < green[group] + yellow ? Light::kYellow : Light::kRed;
}

double SignalPlan::UntilGreen(int group, double time) const {
  if (At(group, time) != Light::kRed) return 0.0;
  return Cycle() - SinceGreen(*this, group, time);
}

}  // namespace maneuver::data::town
