// What recordings look like, as a picture.

#ifndef MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_
#define MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

struct RecordingsPlotOptions {
  // Pixels; 0: by the number of recordings.
  int width = 0;
  int height = 0;
  // What is seen of each recording around its middle, metres from left to right.
  double extent = 140.0;
  // How far the paths of agents are drawn, seconds; 0: as far as they are known.
  double horizon = 8.0;
};

// Draws one panel for each recording, north up, axes in metres from the middle of what moves: its
// map, the agents at the prediction time with their past second (vehicles that are targets yellow,
// others red) and, by type, the paths that they go then. A recording where nobody is in sight at
// its prediction time is drawn at the middle of its time. Returns a PNG file; the same for the same
// input. INVALID_ARGUMENT if there is nothing to draw or the size is out of range.
absl::StatusOr<std::string> DrawRecordings(std::span<const v1::Scenario> recordings,
                                           const RecordingsPlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_
