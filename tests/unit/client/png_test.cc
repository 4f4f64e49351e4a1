#include "client/plot/png.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "tests/unit/client/pictures_for_tests.h"

namespace maneuver::plot::png_test {
namespace {

cv::Mat Noise(int rows, int columns) {
  cv::Mat picture(rows, columns, CV_8UC3);
  cv::RNG random(17);
  random.fill(picture, cv::RNG::UNIFORM, 0, 256);
  return picture;
}

TEST(PngTest, AnotherReaderReadsEveryPixelBack) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(7, 3), cv::Size(301, 200)}) {
    const cv::Mat picture = Noise(size.height, size.width);
    const cv::Mat read = Decode(EncodePng(picture));
    ASSERT_EQ(read.size(), size);
    EXPECT_EQ(cv::norm(read, picture, cv::NORM_INF), 0.0);
  }
}

TEST(PngTest, WritesOnlyThePartOfALargerPicture) {
  const cv::Mat part = Noise(20, 30)(cv::Rect(5, 4, 11, 9));
  const cv::Mat read = Decode(EncodePng(part));
  ASSERT_EQ(read.size(), cv::Size(11, 9));
  EXPECT_EQ(cv::norm(read, part, cv::NORM_INF), 0.0);
}

TEST(PngTest, CompressesRepeatedPixels) {
  const cv::Mat paper(600, 900, CV_8UC3, cv::Scalar(255, 255, 255));
  EXPECT_LT(EncodePng(paper).size(), 4000u);
}

}  // namespace
}  // namespace maneuver::plot::png_test
