// Traffic signals of one junction. Groups of lanes have green one after the other. All times are in
// seconds.

#ifndef MANEUVER_MODEL_DATA_TOWN_SIGNALS_H_
#define MANEUVER_MODEL_DATA_TOWN_SIGNALS_H_

#include <vector>

namespace maneuver::data::town {

enum class Light { kRed, kYellow, kGreen };

// A fixed-time plan. Group 0 is green from `offset` on, then group 1, and so on, then group 0
// again. After each green come yellow and then a time in which all are red.
struct SignalPlan {
  std::vector<double> green;  // one per group; empty without signals
  double yellow = 3.0;
  double all_red = 2.0;
  double offset = 0.0;

  double Cycle() const;
  Light At(int group, double time) const;
  // Returns the time from `time` until the group's next change from red to green; 0 if it is not
  // red.
  double UntilGreen(int group, double time) const;
};

}  // namespace maneuver::data::town

#endif  // MANEUVER_MODEL_DATA_TOWN_SIGNALS_H_
