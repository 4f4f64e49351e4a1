#include "client/plot/png.h"

#include <png.h>

#include <cassert>

namespace maneuver::plot {

std::string EncodePng(const cv::Mat& picture) {
  assert(picture.type() == CV_8UC3);
  png_image image = {};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(picture.cols);
  image.height = static_cast<png_uint_32>(picture.rows);
  image.format = PNG_FORMAT_BGR;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string png(size, '\0');
  [[maybe_unused]] const int written =
      png_image_write_to_memory(&image, png.data(), &size, /*convert_to_8_bit=*/0, picture.data,
                                static_cast<png_int_32>(picture.step1()), /*colormap=*/nullptr);
  assert(written != 0);  // there is room for all of it
  png.resize(size);
  return png;
}

}  // namespace maneuver::plot
