// Private to plot/: pictures as PNG files.

#ifndef MANEUVER_CLIENT_PLOT_PNG_H_
#define MANEUVER_CLIENT_PLOT_PNG_H_

#include <opencv2/core.hpp>
#include <string>

namespace maneuver::plot {

// A PNG file (RFC 2083), 8 bits a channel. OpenCV's own writer comes with GDAL and what that wants:
// more than a hundred packages on every machine that has the command.
//   picture: rows of blue, green, red, as OpenCV has them (CV_8UC3).
std::string EncodePng(const cv::Mat& picture);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_PNG_H_
