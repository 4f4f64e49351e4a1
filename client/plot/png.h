// Private to plot/: writes pictures as PNG files.

#ifndef MANEUVER_CLIENT_PLOT_PNG_H_
#define MANEUVER_CLIENT_PLOT_PNG_H_

#include <opencv2/core.hpp>
#include <string>

namespace maneuver::plot {

// Returns a PNG file (RFC 2083) with 8 bits per channel, by libpng. OpenCV's own writer depends on
// GDAL, which needs more than a hundred packages on every machine that has the command.
//   picture: rows of blue, green, red, as in OpenCV (CV_8UC3).
std::string EncodePng(const cv::Mat& picture);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_PNG_H_
