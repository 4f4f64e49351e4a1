// Draws recordings.

#ifndef MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_
#define MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "maneuver/v1/scenario.pb.h"

namespace maneuver::plot {

struct RecordingsPlotOptions {
  // Pixels; 0: chosen by the number of recordings.
  int width = 0;
  int height = 0;
  // The width of what a panel shows around the recording's middle, metres.
  double extent = 140.0;
  // How far the paths of agents are drawn, seconds; 0: to their end.
  double horizon = 8.0;
};

// Draws one panel for each recording, y up, axes in metres from the middle of its targets (without
// any, of its vehicles, or of all agents): its map, the agents at the prediction time with their
// past second (target vehicles yellow, others red), and their future paths by type. A recording
// without any agent at its prediction time is drawn at its middle time, or left out if there is
// none then either. Returns a PNG file; the same input gives the same file. INVALID_ARGUMENT if
// there is nothing to draw or the size is out of range.
absl::StatusOr<std::string> DrawRecordings(std::span<const v1::Scenario> recordings,
                                           const RecordingsPlotOptions& options);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_RECORDINGS_PLOT_H_
