#include "model/scene/brush.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace maneuver::scene::brush_test {
namespace {

constexpr int kHeight = 24;
constexpr int kWidth = 32;

class BrushTest : public testing::Test {
 protected:
  // Reads what was painted since the last call, and clears it.
  void Finish() {
    raster_.WriteInterleaved(picture_);
    raster_.Clear();
  }
  int at(int row, int column) const { return picture_[row * kWidth + column]; }
  double Total() const {
    double total = 0.0;
    for (const uint8_t value : picture_) total += value;
    return total / 255.0;
  }
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  std::vector<uint8_t> picture_ = std::vector<uint8_t>(kHeight * kWidth);
  Raster raster_{kHeight, kWidth, 1};
  Brush brush_;
  std::mt19937_64 random_{7};
};

// Even-odd crossing test.
bool Inside(const std::vector<PixelPoint>& polygon, double u, double v) {
  bool inside = false;
  for (size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const PixelPoint& a = polygon[i];
    const PixelPoint& b = polygon[j];
    if ((a.v > v) != (b.v > v) && u < a.u + (v - a.v) / (b.v - a.v) * (b.u - a.u)) {
      inside = !inside;
    }
  }
  return inside;
}

double DistanceToPolyline(const std::vector<PixelPoint>& points, double u, double v) {
  double nearest = HUGE_VAL;
  for (size_t i = 1; i < points.size(); ++i) {
    const PixelPoint& a = points[i - 1];
    const double du = points[i].u - a.u;
    const double dv = points[i].v - a.v;
    const double squared = du * du + dv * dv;
    const double t =
        squared == 0.0 ? 0.0 : std::clamp(((u - a.u) * du + (v - a.v) * dv) / squared, 0.0, 1.0);
    nearest = std::min(nearest, std::hypot(u - a.u - t * du, v - a.v - t * dv));
  }
  return nearest;
}

TEST_F(BrushTest, APolygonCoversEachPixelByItsShare) {
  constexpr int kSamples = 40;  // along each side of a pixel
  // An edge through a pixel misjudges at most about one row of samples.
  constexpr double kTolerance = 255.0 * 2.0 / kSamples;
  for (int trial = 0; trial < 20; ++trial) {
    // A star around a centre that may lie outside: simple, mostly not convex, often clipped.
    const PixelPoint centre{Uniform(-6, kWidth + 6), Uniform(-6, kHeight + 6)};
    std::vector<PixelPoint> polygon;
    const int corners = 3 + trial % 6;
    for (int i = 0; i < corners; ++i) {
      const double angle = 2.0 * M_PI * i / corners * (trial % 2 == 0 ? 1 : -1);
      const double radius = Uniform(2, 20);
      polygon.push_back({centre.u + radius * std::cos(angle), centre.v + radius * std::sin(angle)});
    }
    brush_.FillPolygon(&raster_, 0, polygon, 255);
    Finish();
    for (int row = 0; row < kHeight; ++row) {
      for (int column = 0; column < kWidth; ++column) {
        int inside = 0;
        for (int i = 0; i < kSamples * kSamples; ++i) {
          inside += Inside(polygon, column + (i % kSamples + 0.5) / kSamples,
                           row + (i / kSamples + 0.5) / kSamples);
        }
        ASSERT_NEAR(at(row, column), 255.0 * inside / (kSamples * kSamples), kTolerance)
            << "trial " << trial << " row " << row << " column " << column;
      }
    }
  }
}

TEST_F(BrushTest, PolygonOfFractionalPixels) {
  const PixelPoint corners[] = {{2.25, 3.5}, {4.5, 3.5}, {4.5, 5.0}, {2.25, 5.0}};
  brush_.FillPolygon(&raster_, 0, corners, 200);
  Finish();
  EXPECT_EQ(at(3, 2), 75);   // 0.75 * 0.5 * 200
  EXPECT_EQ(at(3, 3), 100);  // 0.5 * 200
  EXPECT_EQ(at(3, 4), 50);   // 0.5 * 0.5 * 200
  EXPECT_EQ(at(4, 2), 150);
  EXPECT_EQ(at(4, 3), 200);
  EXPECT_EQ(at(4, 4), 100);
  EXPECT_EQ(at(5, 3), 0);
  EXPECT_EQ(at(2, 3), 0);
  EXPECT_EQ(at(4, 1), 0);
  EXPECT_EQ(at(4, 5), 0);
}

TEST_F(BrushTest, APolygonLeavesNoScratchForTheNext) {
  const PixelPoint first[] = {{-50, -50}, {90, -40}, {10, 90}};
  const PixelPoint second[] = {{3, 3}, {4, 3}, {4, 4}, {3, 4}};
  brush_.FillPolygon(&raster_, 0, first, 255);
  Finish();
  brush_.FillPolygon(&raster_, 0, second, 255);
  Finish();
  EXPECT_EQ(at(3, 3), 255);
  EXPECT_DOUBLE_EQ(Total(), 1.0);
}

TEST_F(BrushTest, PolygonAroundThePictureCoversAllOfIt) {
  const PixelPoint corners[] = {{-1e10, -3e10}, {2e10, -1e10}, {1e10, 4e10}, {-3e10, 2e10}};
  brush_.FillPolygon(&raster_, 0, corners, 77);
  Finish();
  for (const uint8_t value : picture_) ASSERT_EQ(value, 77);
}

TEST_F(BrushTest, BoxAlongThePictureCoversEachPixelByItsShare) {
  brush_.FillBox(&raster_, 0, {10.0, 8.25}, {1.0, 0.0}, 2.5, 1.0, 200);
  Finish();
  // u from 7.5 to 12.5, v from 7.25 to 9.25.
  const double across[] = {0, 0.5, 1, 1, 1, 1, 0.5, 0};
  const double down[] = {0, 0.75, 1, 0.25, 0};
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 8; ++column) {
      EXPECT_EQ(at(6 + row, 6 + column), std::lround(200 * across[column] * down[row]))
          << row << " " << column;
    }
  }
  EXPECT_NEAR(Total() * 255.0 / 200.0, 5.0 * 2.0, 0.05);
}

TEST_F(BrushTest, BoxesCoverTheirAreaAtEveryAngle) {
  for (int trial = 0; trial < 200; ++trial) {
    const double angle = Uniform(-M_PI, M_PI);
    const double half_length = Uniform(0.2, 5.0);
    const double half_width = Uniform(0.2, 3.0);
    brush_.FillBox(&raster_, 0, {Uniform(12, 20), Uniform(10, 14)},
                   {std::cos(angle), std::sin(angle)}, half_length, half_width, 255);
    Finish();
    const double area = 4.0 * half_length * half_width;
    EXPECT_NEAR(Total(), area, 0.25 + 0.02 * area) << "angle " << angle;
  }
}

TEST_F(BrushTest, ABoxMatchesThePolygonOfItsCorners) {
  constexpr double kTolerance = 0.2 * 255.0;  // the filters differ at corners
  constexpr double kMeanTolerance = 1.0;
  for (int trial = 0; trial < 50; ++trial) {
    const double angle = Uniform(-M_PI, M_PI);
    const PixelPoint d{std::cos(angle), std::sin(angle)};
    const PixelPoint c{Uniform(0, kWidth), Uniform(0, kHeight)};
    const double a = Uniform(1, 6);
    const double b = Uniform(1, 4);
    brush_.FillBox(&raster_, 0, c, d, a, b, 255);
    Finish();
    const std::vector<uint8_t> box = picture_;
    const PixelPoint corners[] = {{c.u + a * d.u - b * d.v, c.v + a * d.v + b * d.u},
                                  {c.u - a * d.u - b * d.v, c.v - a * d.v + b * d.u},
                                  {c.u - a * d.u + b * d.v, c.v - a * d.v - b * d.u},
                                  {c.u + a * d.u + b * d.v, c.v + a * d.v - b * d.u}};
    brush_.FillPolygon(&raster_, 0, corners, 255);
    Finish();
    double sum = 0.0;
    for (size_t i = 0; i < box.size(); ++i) {
      ASSERT_NEAR(box[i], picture_[i], kTolerance);
      sum += std::abs(box[i] - picture_[i]);
    }
    EXPECT_LT(sum / static_cast<double>(box.size()), kMeanTolerance);
  }
}

TEST_F(BrushTest, CoverageOfAPolylineFallsWithDistance) {
  // Simplification may move the line by 0.03 pixels; rounding adds half a level.
  constexpr double kTolerance = 0.03 * 255.0 + 1.0;
  for (int trial = 0; trial < 40; ++trial) {
    // From wide zigzags to smooth curves of many short steps, some of them backwards.
    const double step = trial % 4 == 0 ? 12.0 : 0.7;
    const double turn = trial % 4 == 1 ? 2.0 : 0.15;
    std::vector<PixelPoint> points = {{Uniform(-4, kWidth + 4), Uniform(-4, kHeight + 4)}};
    double heading = Uniform(-M_PI, M_PI);
    for (int i = 0; i < 60; ++i) {
      heading += Uniform(-turn, turn);
      points.push_back(
          {points.back().u + step * std::cos(heading), points.back().v + step * std::sin(heading)});
    }
    brush_.DrawPolyline(&raster_, 0, PixelLine(points), 255);
    Finish();
    for (int row = 0; row < kHeight; ++row) {
      for (int column = 0; column < kWidth; ++column) {
        const double distance = DistanceToPolyline(points, column + 0.5, row + 0.5);
        ASSERT_NEAR(at(row, column), 255.0 * std::max(0.0, 1.0 - distance), kTolerance)
            << "trial " << trial << " row " << row << " column " << column;
      }
    }
  }
}

// Both ends lie outside, on different sides; the part between them shows.
TEST_F(BrushTest, PolylineAroundThePictureCutsItsCorners) {
  constexpr double kBeyond = 5.0;
  const std::vector<PixelPoint> beside = {{0.5 * kWidth, -kBeyond},
                                          {kWidth + kBeyond, 0.5 * kHeight},
                                          {0.5 * kWidth, kHeight + kBeyond},
                                          {-kBeyond, 0.5 * kHeight}};
  for (size_t i = 0; i < beside.size(); ++i) {
    const std::vector<PixelPoint> line = {beside[i], beside[(i + 1) % beside.size()]};
    brush_.DrawPolyline(&raster_, 0, PixelLine(line), 255);
    Finish();
    int nonzero = 0;
    for (int row = 0; row < kHeight; ++row) {
      for (int column = 0; column < kWidth; ++column) {
        const double distance = DistanceToPolyline(line, column + 0.5, row + 0.5);
        ASSERT_NEAR(at(row, column), 255.0 * std::max(0.0, 1.0 - distance), 1.0);
        nonzero += at(row, column) > 0 ? 1 : 0;
      }
    }
    EXPECT_GT(nonzero, 5) << "corner " << i;
  }
}

TEST_F(BrushTest, APolylineThatTurnsBackKeepsItsTip) {
  const PixelPoint points[] = {{4, 10.5}, {14, 10.5}, {8, 10.5}};
  brush_.DrawPolyline(&raster_, 0, PixelLine(points), 255);
  Finish();
  for (int column = 4; column < 14; ++column) EXPECT_EQ(at(10, column), 255) << column;
  EXPECT_EQ(at(10, 15), 0);
}

TEST_F(BrushTest, APolylineFromFarAwayCrossesAtTheRightPlace) {
  const PixelPoint points[] = {{-1e10, 5.5}, {1e10, 5.5}};
  brush_.DrawPolyline(&raster_, 0, PixelLine(points), 255);
  Finish();
  for (int column = 0; column < kWidth; ++column) {
    EXPECT_EQ(at(5, column), 255);
    EXPECT_EQ(at(4, column), 0);
    EXPECT_EQ(at(6, column), 0);
  }
}

TEST_F(BrushTest, PolylineOfOnePointIsNotDrawn) {
  const PixelPoint points[] = {{5.5, 5.5}};
  brush_.DrawPolyline(&raster_, 0, PixelLine(points), 255);
  Finish();
  EXPECT_EQ(Total(), 0.0);
}

TEST_F(BrushTest, DiscHasItsRadius) {
  brush_.FillDisc(&raster_, 0, {10.5, 10.5}, 1.5, 200);
  Finish();
  EXPECT_EQ(at(10, 10), 200);
  EXPECT_EQ(at(10, 11), 200);
  EXPECT_EQ(at(11, 11), std::lround(200 * (2.0 - std::sqrt(2.0))));
  EXPECT_EQ(at(10, 12), 0);
}

TEST_F(BrushTest, TheBrighterPaintShowsInEitherOrder) {
  const PixelPoint square[] = {{8, 8}, {12, 8}, {12, 12}, {8, 12}};
  const PixelPoint line[] = {{4, 10.5}, {16, 10.5}};
  const std::function<void(uint8_t)> shapes[] = {
      [&](uint8_t intensity) {
        brush_.FillBox(&raster_, 0, {10, 10}, {1, 0}, 2, 2, intensity);
      },
      [&](uint8_t intensity) { brush_.FillPolygon(&raster_, 0, square, intensity); },
      [&](uint8_t intensity) {
        brush_.FillDisc(&raster_, 0, {10, 10}, 3, intensity);
      },
      [&](uint8_t intensity) { brush_.DrawPolyline(&raster_, 0, PixelLine(line), intensity); }};
  for (const auto& first : shapes) {
    for (const auto& second : shapes) {
      first(100);
      second(200);
      Finish();
      EXPECT_EQ(at(10, 10), 200);
      first(200);
      second(100);
      Finish();
      EXPECT_EQ(at(10, 10), 200);
    }
  }
}

TEST(InterleavedRasterTest, PaintsOnlyOneChannel) {
  std::vector<uint8_t> picture(4 * 4 * 3);
  Raster raster(4, 4, 3);
  Brush::FillBox(&raster, 1, {1.5, 2.5}, {1, 0}, 0.5, 0.5, 99);
  raster.WriteInterleaved(picture);
  for (int i = 0; i < 4 * 4 * 3; ++i) EXPECT_EQ(picture[i], i == (2 * 4 + 1) * 3 + 1 ? 99 : 0);
}

// What lies beyond the right edge does not show, nor at the start of the next row.
TEST(InterleavedRasterTest, ANarrowPictureIsTheLeftPartOfAWideOne) {
  constexpr int kRows = 20;
  constexpr int kWide = 40;
  const auto paint = [](int columns) {
    Raster raster(kRows, columns, 2);
    Brush brush;
    const PixelPoint line[] = {{-3, 2}, {9, 7}, {38, 12}};
    const PixelPoint triangle[] = {{1, 18}, {35, 19}, {20, 9}};
    brush.DrawPolyline(&raster, 0, PixelLine(line), 255);
    brush.FillBox(&raster, 0, {11, 5}, {0.8, 0.6}, 7, 4, 200);
    brush.FillDisc(&raster, 1, {13, 4}, 3, 150);
    brush.FillPolygon(&raster, 1, triangle, 90);
    std::vector<uint8_t> picture(static_cast<size_t>(kRows) * columns * 2, 77);
    raster.WriteInterleaved(picture);
    return picture;
  };
  const std::vector<uint8_t> wide = paint(kWide);
  for (const int columns : {1, 7, 8, 9, 13, 16, 31}) {
    const std::vector<uint8_t> narrow = paint(columns);
    for (int row = 0; row < kRows; ++row) {
      for (int i = 0; i < columns * 2; ++i) {
        // Lines are clipped elsewhere, and rounded.
        ASSERT_NEAR(narrow[row * columns * 2 + i], wide[row * kWide * 2 + i], 1)
            << columns << " columns, row " << row << ", byte " << i;
      }
    }
  }
}

// At any width, everything painted is kept, and nothing is left for the next picture.
TEST(InterleavedRasterTest, TheRightEndOfAWidePictureIsLikeANarrowOne) {
  constexpr int kRows = 20;
  constexpr int kSeen = 30;
  const auto paint = [](int columns) {
    Raster raster(kRows, columns, 2);
    Brush brush;
    const double left = columns - kSeen;
    const PixelPoint line[] = {{left + 2, 2}, {left + 9, 7}, {left + 38, 12}};
    const PixelPoint triangle[] = {{left + 1, 18}, {left + 35, 19}, {left + 20, 9}};
    brush.DrawPolyline(&raster, 0, PixelLine(line), 255);
    brush.FillBox(&raster, 0, {left + 11, 5}, {0.8, 0.6}, 7, 4, 200);
    brush.FillDisc(&raster, 1, {left + 13, 4}, 3, 150);
    brush.FillPolygon(&raster, 1, triangle, 90);
    std::vector<uint8_t> picture(static_cast<size_t>(kRows) * columns * 2, 77);
    raster.WriteInterleaved(picture);
    std::vector<uint8_t> next(picture.size(), 77);
    raster.Clear();
    raster.WriteInterleaved(next);
    EXPECT_EQ(next, std::vector<uint8_t>(picture.size())) << columns;
    return picture;
  };
  const std::vector<uint8_t> narrow = paint(kSeen);
  for (const int columns : {448, 500, 505, 600, 1000, 2000}) {
    const std::vector<uint8_t> wide = paint(columns);
    for (int row = 0; row < kRows; ++row) {
      for (int i = 0; i < kSeen * 2; ++i) {
        ASSERT_NEAR(wide[(row * columns + columns - kSeen) * 2 + i], narrow[row * kSeen * 2 + i], 1)
            << columns << " columns, row " << row << ", byte " << i;
      }
    }
  }
}

}  // namespace
}  // namespace maneuver::scene::brush_test
