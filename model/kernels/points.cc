#include "model/kernels/points.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/kernels/kernel_choice.h"

// What follows is compiled once for each target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/kernels/points.cc"
#include <hwy/foreach_target.h>
// It must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace maneuver::kernels::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
// Four lanes on every target: there are often only a few points.
using Doubles = hn::CappedTag<double, kPointLanes>;
using One = hn::CappedTag<double, 1>;
using Vector = hn::Vec<Doubles>;
constexpr size_t kLanes = hn::MaxLanes(Doubles());

// What is done to long lines takes more, where there are more.
using Many = hn::CappedTag<double, 2 * kPointLanes>;
constexpr size_t kManyLanes = hn::MaxLanes(Many());

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr PointBox kNoPoints = {kInfinity, kInfinity, -kInfinity, -kInfinity};

// Calls call(d, i) for vectors of points, then for single ones.
template <class Call>
HWY_INLINE void ForPoints(size_t count, const Call& call) {
  size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) call(Doubles(), i);
  for (; i < count; ++i) call(One(), i);
}

bool FastAllWithin(const double* values, size_t count, double limit) {
  const Doubles d;
  auto good = hn::Eq(hn::Zero(d), hn::Zero(d));
  size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    good = hn::And(good, hn::Le(hn::Abs(hn::LoadU(d, values + i)), hn::Set(d, limit)));
  }
  bool all = hn::AllTrue(d, good);
  for (; i < count; ++i) all &= std::abs(values[i]) <= limit;
  return all;
}

void FastProject(const PointView& view, const double* x, const double* y, size_t count, double* u,
                 double* v) {
  ForPoints(count, [&](auto d, size_t i) HWY_ATTR {
    const auto c = hn::Set(d, view.cosine);
    const auto s = hn::Set(d, view.sine);
    const auto scale = hn::Set(d, view.scale);
    const auto dx = hn::Sub(hn::LoadU(d, x + i), hn::Set(d, view.x));
    const auto dy = hn::Sub(hn::LoadU(d, y + i), hn::Set(d, view.y));
    const auto along = hn::Add(hn::Mul(c, dx), hn::Mul(s, dy));
    const auto across = hn::Add(hn::Mul(hn::Neg(s), dx), hn::Mul(c, dy));
    hn::StoreU(hn::Add(hn::Set(d, view.origin_u), hn::Mul(scale, along)), d, u + i);
    hn::StoreU(hn::Sub(hn::Set(d, view.origin_v), hn::Mul(scale, across)), d, v + i);
  });
}

void FastMove(const PointMotion& motion, const double* points, size_t count, double* x, double* y) {
  ForPoints(count, [&](auto d, size_t i) HWY_ATTR {
    const auto c = hn::Set(d, motion.cosine);
    const auto s = hn::Set(d, motion.sine);
    hn::Vec<decltype(d)> px = hn::Set(d, points[2 * i]);
    hn::Vec<decltype(d)> py = hn::Set(d, points[2 * i + 1]);
    if constexpr (hn::MaxLanes(decltype(d)()) > 1) hn::LoadInterleaved2(d, points + 2 * i, px, py);
    hn::StoreU(hn::Sub(hn::Add(hn::Set(d, motion.x), hn::Mul(c, px)), hn::Mul(s, py)), d, x + i);
    hn::StoreU(hn::Add(hn::Add(hn::Set(d, motion.y), hn::Mul(s, px)), hn::Mul(c, py)), d, y + i);
  });
}

// Sets for each point the sides of a picture that it lies beyond, one bit each: left 1, right 2,
// above 4, below 8.
void FastSides(const double* u, const double* v, size_t count, const PictureArea& picture,
               int64_t* sides) {
  const Doubles d;
  const hn::RebindToSigned<Doubles> words;
  const auto bit = [&](auto beyond, int64_t side) HWY_ATTR {
    return hn::And(hn::VecFromMask(words, hn::RebindMask(words, beyond)), hn::Set(words, side));
  };
  for (size_t i = 0; i < count; i += kLanes) {
    const Vector at_u = hn::LoadU(d, u + i);
    const Vector at_v = hn::LoadU(d, v + i);
    const auto across = hn::Or(bit(hn::Lt(at_u, hn::Set(d, -picture.reach)), 1),
                               bit(hn::Gt(at_u, hn::Set(d, picture.width + picture.reach)), 2));
    const auto along = hn::Or(bit(hn::Lt(at_v, hn::Set(d, -picture.reach)), 4),
                              bit(hn::Gt(at_v, hn::Set(d, picture.height + picture.reach)), 8));
    hn::StoreU(hn::Or(across, along), words, sides + i);
  }
}

// Searches for the end of a chord, given passes(start, end).
template <class Passes>
HWY_INLINE size_t SearchChordEnd(size_t start, size_t last, const Passes& passes) {
  // Twice as far for as long as it goes; then half as far from where it went, and so on.
  size_t end = start + 1;
  size_t step = 7;
  while (end < last && passes(start, std::min(end + step, last))) {
    end = std::min(end + step, last);
    step = end - start;
  }
  for (step = std::min(step, last - end) / 2; step > 0; step /= 2) {
    if (passes(start, end + step)) end += step;
  }
  return end;
}

// Finds the chords of a line, given passes(start, end) and the sides that each point lies beyond.
template <class Passes>
HWY_INLINE size_t SearchChords(const int64_t* sides, size_t count, const Passes& passes,
                               Chord* chords) {
  size_t found = 0;
  const auto is_unseen = [sides](size_t end) { return (sides[end - 1] & sides[end]) != 0; };
  for (size_t end = 1; end < count;) {
    if (is_unseen(end)) {
      ++end;
      continue;
    }
    // From where the line may be seen to where it no longer can.
    size_t start = end - 1;
    while (end < count && !is_unseen(end)) ++end;
    while (start + 1 < end) {
      const size_t next = SearchChordEnd(start, end - 1, passes);
      chords[found++] = {static_cast<uint32_t>(start), static_cast<uint32_t>(next)};
      start = next;
    }
  }
  return found;
}

// Returns whether the chord passes all points between its ends.
bool ChordPasses(const double* u, const double* v, size_t start, size_t end, double tolerance) {
  const Doubles d;
  const double du = u[end] - u[start];
  const double dv = v[end] - v[start];
  const double squared = du * du + dv * dv;
  const double farthest = tolerance * tolerance;
  const bool is_point = squared <= farthest;  // has no beside
  const Vector from_u = hn::Set(d, u[start]);
  const Vector from_v = hn::Set(d, v[start]);
  const Vector chord_u = hn::Set(d, du);
  const Vector chord_v = hn::Set(d, dv);
  for (size_t i = start + 1; i < end; i += kLanes) {
    const Vector off_u = hn::Sub(hn::LoadU(d, u + i), from_u);
    const Vector off_v = hn::Sub(hn::LoadU(d, v + i), from_v);
    const Vector across = hn::Sub(hn::Mul(off_u, chord_v), hn::Mul(off_v, chord_u));
    const Vector along = hn::Add(hn::Mul(off_u, chord_u), hn::Mul(off_v, chord_v));
    auto missed = hn::Or(hn::Gt(hn::Mul(across, across), hn::Set(d, farthest * squared)),
                         hn::Or(hn::Lt(along, hn::Zero(d)), hn::Gt(along, hn::Set(d, squared))));
    if (is_point) {
      missed = hn::Gt(hn::Add(hn::Mul(off_u, off_u), hn::Mul(off_v, off_v)), hn::Set(d, farthest));
    }
    // What lies behind the last point does not count.
    if (!hn::AllFalse(d, hn::And(missed, hn::FirstN(d, end - i)))) return false;
  }
  return true;
}

size_t FastChords(const double* u, const double* v, size_t count, const PictureArea& picture,
                  double tolerance, int64_t* sides, Chord* chords) {
  FastSides(u, v, count, picture, sides);
  const auto passes = [=](size_t from, size_t to)
                          HWY_ATTR { return ChordPasses(u, v, from, to, tolerance); };
  return SearchChords(sides, count, passes, chords);
}

// Finds the box of at least as many points as D has lanes. Returns whether all are finite.
template <class D>
HWY_INLINE bool BoxOf(D d, const PointLine& line, PointBox* box) {
  constexpr size_t kTogether = hn::MaxLanes(D());
  const auto load = [d](const double* values, size_t i)
                        HWY_ATTR { return hn::LoadU(d, values + i); };
  // A point that is taken twice changes nothing.
  const size_t last = line.count - kTogether;
  hn::Vec<D> low_x = load(line.x, last);
  hn::Vec<D> low_y = load(line.y, last);
  hn::Vec<D> high_x = low_x;
  hn::Vec<D> high_y = low_y;
  // The sum of a point's coordinates is NaN if either is.
  hn::Vec<D> sum = hn::Add(low_x, low_y);
  auto numbers = hn::Eq(sum, sum);
  for (size_t i = 0; i < last; i += kTogether) {
    const auto x = load(line.x, i);
    const auto y = load(line.y, i);
    low_x = hn::Min(low_x, x);
    low_y = hn::Min(low_y, y);
    high_x = hn::Max(high_x, x);
    high_y = hn::Max(high_y, y);
    sum = hn::Add(x, y);
    numbers = hn::And(numbers, hn::Eq(sum, sum));
  }
  *box = {.low_x = hn::GetLane(hn::MinOfLanes(d, low_x)),
          .low_y = hn::GetLane(hn::MinOfLanes(d, low_y)),
          .high_x = hn::GetLane(hn::MaxOfLanes(d, high_x)),
          .high_y = hn::GetLane(hn::MaxOfLanes(d, high_y))};
  return hn::AllTrue(d, numbers) && box->low_x > -kInfinity && box->low_y > -kInfinity &&
         box->high_x < kInfinity && box->high_y < kInfinity;
}

bool FastBoxes(const PointLine* lines, size_t count, PointBox* boxes) {
  bool finite = true;
  for (size_t i = 0; i < count; ++i) {
    if (lines[i].count >= kManyLanes) {
      finite &= BoxOf(Many(), lines[i], &boxes[i]);
    } else if (lines[i].count >= kLanes) {
      finite &= BoxOf(Doubles(), lines[i], &boxes[i]);
    } else if (lines[i].count > 0) {
      finite &= BoxOf(One(), lines[i], &boxes[i]);
    } else {
      boxes[i] = kNoPoints;
    }
  }
  return finite;
}

// Of at least as many points as D has lanes.
template <class D>
HWY_INLINE PointSpread SpreadOf(D d, const double* x, const double* y, int first, int last) {
  using V = hn::Vec<D>;
  const double dx = x[last] - x[first];
  const double dy = y[last] - y[first];
  const double squared = dx * dx + dy * dy;
  V low_x = hn::Set(d, x[last]);
  V low_y = hn::Set(d, y[last]);
  V high_x = low_x;
  V high_y = low_y;
  V farthest = hn::Zero(d);
  auto astray = hn::Lt(hn::Zero(d), hn::Zero(d));
  const auto take = [&](const double* some_x, const double* some_y) HWY_ATTR {
    const V at_x = hn::LoadU(d, some_x);
    const V at_y = hn::LoadU(d, some_y);
    low_x = hn::Min(low_x, at_x);
    low_y = hn::Min(low_y, at_y);
    high_x = hn::Max(high_x, at_x);
    high_y = hn::Max(high_y, at_y);
    const V off_x = hn::Sub(at_x, hn::Set(d, x[first]));
    const V off_y = hn::Sub(at_y, hn::Set(d, y[first]));
    const V across = hn::Sub(hn::Mul(off_x, hn::Set(d, dy)), hn::Mul(off_y, hn::Set(d, dx)));
    const V along = hn::Add(hn::Mul(off_x, hn::Set(d, dx)), hn::Mul(off_y, hn::Set(d, dy)));
    farthest = hn::Max(farthest, hn::Mul(across, across));
    astray = hn::Or(astray, hn::Or(hn::Lt(along, hn::Zero(d)), hn::Gt(along, hn::Set(d, squared))));
  };
  // A point that is taken twice changes nothing.
  constexpr int kTogether = hn::MaxLanes(D());
  for (int i = first; i + kTogether <= last; i += kTogether) take(x + i, y + i);
  take(x + last + 1 - kTogether, y + last + 1 - kTogether);
  return {.low_x = hn::GetLane(hn::MinOfLanes(d, low_x)),
          .low_y = hn::GetLane(hn::MinOfLanes(d, low_y)),
          .high_x = hn::GetLane(hn::MaxOfLanes(d, high_x)),
          .high_y = hn::GetLane(hn::MaxOfLanes(d, high_y)),
          .across_squared = hn::GetLane(hn::MaxOfLanes(d, farthest)),
          .chord_squared = squared,
          .astray = !hn::AllFalse(d, astray)};
}

void FastSpreads(const double* x, const double* y, int count, int intervals, PointSpread* spreads) {
  for (int i = 0; i < SpreadsOf(count, intervals); ++i) {
    const int first = i * intervals;
    const int last = std::min(first + intervals, count - 1);
    const bool fills_vector = last - first >= static_cast<int>(kLanes) - 1;
    spreads[i] =
        fills_vector ? SpreadOf(Doubles(), x, y, first, last) : SpreadOf(One(), x, y, first, last);
  }
}

}  // namespace
}  // namespace maneuver::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace maneuver::kernels {
namespace {

using HWY_NAMESPACE::kNoPoints;

bool PlainAllWithin(const double* values, size_t count, double limit) {
  return std::all_of(values, values + count,
                     [limit](double value) { return std::abs(value) <= limit; });
}

void PlainProject(const PointView& view, const double* x, const double* y, size_t count, double* u,
                  double* v) {
  for (size_t i = 0; i < count; ++i) {
    const double dx = x[i] - view.x;
    const double dy = y[i] - view.y;
    u[i] = view.origin_u + view.scale * (view.cosine * dx + view.sine * dy);
    v[i] = view.origin_v - view.scale * (-view.sine * dx + view.cosine * dy);
  }
}

void PlainMove(const PointMotion& motion, const double* points, size_t count, double* x,
               double* y) {
  for (size_t i = 0; i < count; ++i, points += 2) {
    x[i] = motion.x + motion.cosine * points[0] - motion.sine * points[1];
    y[i] = motion.y + motion.sine * points[0] + motion.cosine * points[1];
  }
}

void PlainSides(const double* u, const double* v, size_t count, const PictureArea& picture,
                int64_t* sides) {
  for (size_t i = 0; i < count; ++i) {
    sides[i] = (u[i] < -picture.reach ? 1 : 0) | (u[i] > picture.width + picture.reach ? 2 : 0) |
               (v[i] < -picture.reach ? 4 : 0) | (v[i] > picture.height + picture.reach ? 8 : 0);
  }
}

bool PlainChordPasses(const double* u, const double* v, size_t start, size_t end,
                      double tolerance) {
  const double du = u[end] - u[start];
  const double dv = v[end] - v[start];
  const double squared = du * du + dv * dv;
  const double farthest = tolerance * tolerance;
  for (size_t i = start + 1; i < end; ++i) {
    const double off_u = u[i] - u[start];
    const double off_v = v[i] - v[start];
    const double across = off_u * dv - off_v * du;
    const double along = off_u * du + off_v * dv;
    const bool missed =
        squared <= farthest  // a point has no beside
            ? off_u * off_u + off_v * off_v > farthest
            : across * across > farthest * squared || along < 0.0 || along > squared;
    if (missed) return false;
  }
  return true;
}

size_t PlainChords(const double* u, const double* v, size_t count, const PictureArea& picture,
                   double tolerance, int64_t* sides, Chord* chords) {
  PlainSides(u, v, count, picture, sides);
  const auto passes = [=](size_t from, size_t to) {
    return PlainChordPasses(u, v, from, to, tolerance);
  };
  return HWY_NAMESPACE::SearchChords(sides, count, passes, chords);
}

bool PlainBoxes(const PointLine* lines, size_t count, PointBox* boxes) {
  bool finite = true;
  for (size_t i = 0; i < count; ++i) {
    boxes[i] = kNoPoints;
    for (size_t point = 0; point < lines[i].count; ++point) {
      const double x = lines[i].x[point];
      const double y = lines[i].y[point];
      boxes[i] = boxes[i].With({x, y, x, y});
      finite &= std::isfinite(x) && std::isfinite(y);
    }
  }
  return finite;
}

PointSpread PlainSpread(const double* x, const double* y, int first, int last) {
  const double dx = x[last] - x[first];
  const double dy = y[last] - y[first];
  PointSpread spread = {.low_x = x[last],
                        .low_y = y[last],
                        .high_x = x[last],
                        .high_y = y[last],
                        .across_squared = 0.0,
                        .chord_squared = dx * dx + dy * dy,
                        .astray = false};
  for (int i = first; i < last; ++i) {
    spread.low_x = std::min(spread.low_x, x[i]);
    spread.low_y = std::min(spread.low_y, y[i]);
    spread.high_x = std::max(spread.high_x, x[i]);
    spread.high_y = std::max(spread.high_y, y[i]);
    const double off_x = x[i] - x[first];
    const double off_y = y[i] - y[first];
    const double across = off_x * dy - off_y * dx;
    const double along = off_x * dx + off_y * dy;
    spread.across_squared = std::max(spread.across_squared, across * across);
    spread.astray |= along < 0.0 || along > spread.chord_squared;
  }
  return spread;
}

void PlainSpreads(const double* x, const double* y, int count, int intervals,
                  PointSpread* spreads) {
  for (int i = 0; i < SpreadsOf(count, intervals); ++i) {
    spreads[i] = PlainSpread(x, y, i * intervals, std::min((i + 1) * intervals, count - 1));
  }
}

HWY_EXPORT(FastAllWithin);
HWY_EXPORT(FastProject);
HWY_EXPORT(FastMove);
HWY_EXPORT(FastChords);
HWY_EXPORT(FastBoxes);
HWY_EXPORT(FastSpreads);

}  // namespace

bool AllWithin(std::span<const double> values, double limit) {
  const auto all = UsesPlainKernels() ? PlainAllWithin : HWY_DYNAMIC_DISPATCH(FastAllWithin);
  return all(values.data(), values.size(), limit);
}

void ProjectPoints(const PointView& view, const double* x, const double* y, size_t count, double* u,
                   double* v) {
  const auto project = UsesPlainKernels() ? PlainProject : HWY_DYNAMIC_DISPATCH(FastProject);
  project(view, x, y, count, u, v);
}

void MovePoints(const PointMotion& motion, const double* points, size_t count, double* x,
                double* y) {
  const auto move = UsesPlainKernels() ? PlainMove : HWY_DYNAMIC_DISPATCH(FastMove);
  move(motion, points, count, x, y);
}

size_t FindChords(const double* u, const double* v, size_t count, const PictureArea& picture,
                  double tolerance, int64_t* sides, Chord* chords) {
  const auto find = UsesPlainKernels() ? PlainChords : HWY_DYNAMIC_DISPATCH(FastChords);
  return find(u, v, count, picture, tolerance, sides, chords);
}

bool FindBoxes(std::span<const PointLine> lines, PointBox* boxes) {
  const auto find = UsesPlainKernels() ? PlainBoxes : HWY_DYNAMIC_DISPATCH(FastBoxes);
  return find(lines.data(), lines.size(), boxes);
}

void FindSpreads(const double* x, const double* y, int count, int intervals, PointSpread* spreads) {
  const auto find = UsesPlainKernels() ? PlainSpreads : HWY_DYNAMIC_DISPATCH(FastSpreads);
  find(x, y, count, intervals, spreads);
}

}  // namespace maneuver::kernels
#endif  // HWY_ONCE
