#include "model/kernels/points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "tests/unit/model/kernels/kernel_test.h"

namespace maneuver::kernels::points_test {
namespace {

constexpr size_t kMost = 23;

std::vector<double> RandomDoubles(size_t count, uint32_t seed, double scale) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0.0, scale);
  std::vector<double> values(count);
  for (double& value : values) value = normal(random);
  return values;
}

class PointsTest : public KernelTest {};
MANEUVER_TEST_EACH_TARGET(PointsTest);

TEST_P(PointsTest, TellsWhetherAllValuesAreWithinALimit) {
  for (size_t count = 0; count < kMost; ++count) {
    std::vector<double> values(count, -3.0);
    EXPECT_TRUE(AllWithin(values, 3.0));
    for (size_t i = 0; i < count; ++i) {
      for (const double bad : {3.5, -3.5, std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity()}) {
        values[i] = bad;
        ASSERT_FALSE(AllWithin(values, 3.0)) << count << " " << i << " " << bad;
      }
      values[i] = -3.0;
    }
  }
}

TEST_P(PointsTest, ProjectsWithTheBitsOfPlain) {
  const auto x = RandomDoubles(kMost, 1, 30.0);
  const auto y = RandomDoubles(kMost, 2, 30.0);
  const PointView view = {.x = 3.0,
                          .y = -7.0,
                          .cosine = std::cos(0.7),
                          .sine = std::sin(0.7),
                          .scale = 1.25,
                          .origin_u = 16.0,
                          .origin_v = 32.0};
  for (size_t count = 0; count <= kMost; ++count) {
    const auto project = [&] {
      std::vector<double> uv(2 * (kMost + kPointLanes), -1.0);
      ProjectPoints(view, x.data(), y.data(), count, uv.data(), uv.data() + kMost + kPointLanes);
      return uv;
    };
    ASSERT_EQ(project(), Plain(project));
    for (size_t i = 0; i < count; ++i) {
      const double along = std::cos(0.7) * (x[i] - 3.0) + std::sin(0.7) * (y[i] + 7.0);
      ASSERT_NEAR(project()[i], 16.0 + 1.25 * along, 1e-12);
    }
  }
}

TEST_P(PointsTest, MovesWithTheBitsOfPlain) {
  const auto points = RandomDoubles(2 * kMost, 3, 30.0);
  const PointMotion motion = {.x = 3.0, .y = -7.0, .cosine = std::cos(0.7), .sine = std::sin(0.7)};
  for (size_t count = 0; count <= kMost; ++count) {
    const auto move = [&] {
      std::vector<double> xy(2 * (count + 1), -1.0);
      MovePoints(motion, points.data(), count, xy.data(), xy.data() + count + 1);
      return xy;
    };
    const auto moved = move();
    ASSERT_EQ(moved, Plain(move));
    ASSERT_EQ(moved[count], -1.0);
    ASSERT_EQ(moved.back(), -1.0);
    for (size_t i = 0; i < count; ++i) {
      // A motion keeps distances from its origin.
      ASSERT_NEAR(std::hypot(moved[i] - 3.0, moved[count + 1 + i] + 7.0),
                  std::hypot(points[2 * i], points[2 * i + 1]), 1e-12);
    }
  }
}

bool SameChords(const std::vector<Chord>& a, const std::vector<Chord>& b) {
  return std::ranges::equal(a, b, [](const Chord& one, const Chord& other) {
    return one.first == other.first && one.last == other.last;
  });
}

// So large that all of a line shows.
constexpr PictureArea kEverything = {.height = 1 << 20, .width = 1 << 20, .reach = 1 << 20};

// Returns the chords of the first `count` points of a line with room behind them.
std::vector<Chord> Chords(std::vector<double> u, std::vector<double> v, size_t count,
                          const PictureArea& picture, double tolerance) {
  std::vector<int64_t> sides(count + kPointLanes);
  std::vector<Chord> chords(count);
  chords.resize(
      FindChords(u.data(), v.data(), count, picture, tolerance, sides.data(), chords.data()));
  return chords;
}

TEST_P(PointsTest, FindsNoChordOfPointsBeyondOneSideOfThePicture) {
  constexpr PictureArea kPicture = {.height = 8, .width = 10, .reach = 1.0};
  constexpr double kInside = 5.0;
  for (const auto& [beyond_u, beyond_v] : std::vector<std::pair<double, double>>{
           {-1.5, kInside}, {11.5, kInside}, {kInside, -1.5}, {kInside, 9.5}}) {
    for (size_t count = 2; count < kMost; ++count) {
      // The line leaves the picture at each place, comes back, and leaves for good.
      for (size_t out = 0; out + 1 < count; ++out) {
        std::vector<double> u(count + kPointLanes, kInside);
        std::vector<double> v(u);
        for (size_t i = 0; i < count; ++i) {
          if (i != out && i != out + 1) continue;
          u[i] = beyond_u;
          v[i] = beyond_v;
        }
        const auto find = [&] { return Chords(u, v, count, kPicture, 0.03); };
        std::set<size_t> joined;  // the first point of each interval on a chord
        for (const Chord& chord : find()) {
          for (size_t i = chord.first; i < chord.last; ++i) ASSERT_TRUE(joined.insert(i).second);
        }
        std::set<size_t> expected;
        for (size_t i = 0; i + 1 < count; ++i) {
          if (i != out) expected.insert(i);
        }
        ASSERT_EQ(joined, expected) << beyond_u << " " << beyond_v << " " << count << " " << out;
        ASSERT_TRUE(SameChords(find(), Plain(find)));
      }
    }
  }
  // Within reach, and at the corners: beyond one side each.
  EXPECT_EQ(Chords({-1.0, 11.0, 0, 0, 0, 0}, {-1.0, 9.0, 0, 0, 0, 0}, 2, kPicture, 0.03).size(),
            1u);
  EXPECT_EQ(Chords({-5.0, 5.0, 0, 0, 0, 0}, {5.0, -5.0, 0, 0, 0, 0}, 2, kPicture, 0.03).size(), 1u);
}

// The distance from point i to the segment between points `start` and `end`.
double DistanceToChord(const std::vector<double>& u, const std::vector<double>& v, size_t start,
                       size_t end, size_t i) {
  const double du = u[end] - u[start];
  const double dv = v[end] - v[start];
  const double share = ((u[i] - u[start]) * du + (v[i] - v[start]) * dv) / (du * du + dv * dv);
  const double within = std::clamp(share, 0.0, 1.0);
  return std::hypot(u[i] - u[start] - within * du, v[i] - v[start] - within * dv);
}

TEST_P(PointsTest, FindsChordsThatPassAllPoints) {
  constexpr size_t kPoints = 200;
  constexpr double kTolerance = 0.03;
  // A bend that becomes sharper. Behind its end lies what must not count.
  std::vector<double> u(kPoints + kPointLanes, 1e6);
  std::vector<double> v(u.size(), 1e6);
  for (size_t i = 0; i < kPoints; ++i) {
    const double angle = 1e-5 * static_cast<double>(i * i);
    u[i] = 30.0 * std::sin(angle);
    v[i] = 30.0 * std::cos(angle);
  }
  const auto find = [&] { return Chords(u, v, kPoints, kEverything, kTolerance); };
  const auto chords = find();
  ASSERT_TRUE(SameChords(chords, Plain(find)));
  size_t start = 0;
  for (const Chord& chord : chords) {
    ASSERT_EQ(chord.first, start);
    ASSERT_GT(chord.last, start);
    for (size_t i = start + 1; i < chord.last; ++i) {
      ASSERT_LE(DistanceToChord(u, v, start, chord.last, i), kTolerance * (1.0 + 1e-9));
    }
    start = chord.last;
  }
  EXPECT_EQ(start, kPoints - 1);
  EXPECT_LT(chords.size(), 40u);
}

TEST_P(PointsTest, EndsNoChordBeyondATurnBack) {
  for (size_t turn = 1; turn < 12; ++turn) {
    std::vector<double> u(13 + kPointLanes);
    const std::vector<double> v(u.size(), 2.0);
    for (size_t i = 0; i < 13; ++i) {
      u[i] = 12.0 - std::abs(static_cast<double>(i) - static_cast<double>(turn));
    }
    ASSERT_LE(Chords(u, v, 13, kEverything, 0.03).at(0).last, turn);
  }
}

std::vector<PointSpread> Spreads(const std::vector<double>& x, const std::vector<double>& y,
                                 int count, int intervals) {
  std::vector<PointSpread> spreads(static_cast<size_t>(SpreadsOf(count, intervals)));
  FindSpreads(x.data(), y.data(), count, intervals, spreads.data());
  return spreads;
}

TEST_P(PointsTest, FindsTheBoxOfEachLine) {
  const auto x = RandomDoubles(kMost, 6, 5.0);
  const auto y = RandomDoubles(kMost, 7, 5.0);
  std::vector<PointLine> lines;
  for (size_t first = 0; first < kMost; ++first) {
    for (size_t count = 0; first + count <= kMost; ++count) {
      lines.push_back({x.data() + first, y.data() + first, count});
    }
  }
  const auto find = [&] {
    std::vector<PointBox> boxes(lines.size());
    EXPECT_TRUE(FindBoxes(lines, boxes.data()));
    return boxes;
  };
  for (const std::vector<PointBox>& boxes : {find(), Plain(find)}) {
    for (size_t i = 0; i < lines.size(); ++i) {
      const auto [line_x, line_y, count] = lines[i];
      if (count == 0) {
        ASSERT_FALSE(boxes[i].Overlaps({-1e300, -1e300, 1e300, 1e300}));
        continue;
      }
      const auto [low_x, high_x] = std::minmax_element(line_x, line_x + count);
      const auto [low_y, high_y] = std::minmax_element(line_y, line_y + count);
      ASSERT_EQ(boxes[i].low_x, *low_x) << i;
      ASSERT_EQ(boxes[i].low_y, *low_y) << i;
      ASSERT_EQ(boxes[i].high_x, *high_x) << i;
      ASSERT_EQ(boxes[i].high_y, *high_y) << i;
    }
  }
}

TEST_P(PointsTest, TellsWhetherAllCoordinatesAreFinite) {
  const std::vector<double> good(kMost, 1e300);
  for (size_t count = 1; count < kMost; ++count) {
    for (size_t i = 0; i < 2 * count; ++i) {
      for (const double bad :
           {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
            -std::numeric_limits<double>::infinity()}) {
        std::vector<double> x(count, -3.0);
        std::vector<double> y(count, 4.0);
        (i < count ? x[i] : y[i - count]) = bad;
        const std::vector<PointLine> lines = {
            {good.data(), good.data(), count}, {x.data(), y.data(), count}, {nullptr, nullptr, 0}};
        std::vector<PointBox> boxes(lines.size());
        ASSERT_FALSE(FindBoxes(lines, boxes.data())) << count << " " << i << " " << bad;
      }
    }
  }
}

TEST_P(PointsTest, FindsTheSpreadOfEachPiece) {
  constexpr int kIntervals = 7;
  const auto x = RandomDoubles(kMost, 4, 5.0);
  const auto y = RandomDoubles(kMost, 5, 5.0);
  for (int count = 0; count <= static_cast<int>(kMost); ++count) {
    const auto find = [&] { return Spreads(x, y, count, kIntervals); };
    const auto spreads = find();
    const auto plain = Plain(find);
    int first = 0;
    for (size_t i = 0; i < spreads.size(); ++i) {
      const int last = std::min(first + kIntervals, count - 1);
      const auto [low, high] = std::minmax_element(x.begin() + first, x.begin() + last + 1);
      ASSERT_EQ(spreads[i].low_x, *low);
      ASSERT_EQ(spreads[i].high_x, *high);
      const auto [low_y, high_y] = std::minmax_element(y.begin() + first, y.begin() + last + 1);
      ASSERT_EQ(spreads[i].low_y, *low_y);
      ASSERT_EQ(spreads[i].high_y, *high_y);
      ASSERT_EQ(spreads[i].across_squared, plain[i].across_squared);
      ASSERT_EQ(spreads[i].chord_squared, plain[i].chord_squared);
      ASSERT_EQ(spreads[i].astray, plain[i].astray);
      first = last;
    }
    if (count > 0) {
      ASSERT_EQ(first, count - 1);
    }
  }
}

TEST_P(PointsTest, FindsTheHeightOfACorner) {
  const PointSpread corner = Spreads({0.0, 1.0, 4.0}, {0.0, 2.0, 0.0}, 3, 16).at(0);
  EXPECT_EQ(corner.across_squared, 64.0);
  EXPECT_EQ(corner.chord_squared, 16.0);
  EXPECT_FALSE(corner.astray);
  EXPECT_TRUE(Spreads({0.0, -1.0, 4.0}, {0.0, 2.0, 0.0}, 3, 16).at(0).astray);
}

}  // namespace
}  // namespace maneuver::kernels::points_test
