#include "model/inference/joint_combinations.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <queue>

#include "model/inference/representatives.h"

namespace maneuver::inference {
namespace {

using scene::Point2;

constexpr double kLongestStep = 0.1;      // seconds between times that are looked at
constexpr double kHeadingReach = 0.2;     // seconds before and after, whose motion is the heading
constexpr double kHeadingDistance = 0.3;  // metres that it needs

// Actions of a target, by their place in JointTarget::actions.
using ActionMask = uint16_t;
static_assert(kMostJointActions <= 16);

double Dot(const Point2& a, const Point2& b) { return a.x * b.x + a.y * b.y; }
double Cross(const Point2& a, const Point2& b) { return a.x * b.y - a.y * b.x; }
Point2 Difference(const Point2& a, const Point2& b) { return {a.x - b.x, a.y - b.y}; }

// Half of a rectangle's sides, metres.
struct Shape {
  double ahead = 0.0;
  double left = 0.0;
};

struct Placement {
  Point2 centre;     // metres, world
  Point2 direction;  // of length 1
};

struct Path {
  std::vector<Placement> placements;  // at the prediction time, and at each time thereafter
  double longest_step = 0.0;          // metres that the centre moves between two of them
};

// Rectangles do not overlap if some side of one of them separates them.
bool Overlap(const Placement& a, const Shape& of_a, const Placement& b, const Shape& of_b) {
  const Point2 apart = Difference(b.centre, a.centre);
  const double along = std::abs(Dot(a.direction, b.direction));
  const double across = std::abs(Cross(a.direction, b.direction));
  return std::abs(Dot(apart, a.direction)) < of_a.ahead + along * of_b.ahead + across * of_b.left &&
         std::abs(Cross(apart, a.direction)) <
             of_a.left + across * of_b.ahead + along * of_b.left &&
         std::abs(Dot(apart, b.direction)) < of_b.ahead + along * of_a.ahead + across * of_a.left &&
         std::abs(Cross(apart, b.direction)) < of_b.left + across * of_a.ahead + along * of_a.left;
}

// Whether two targets overlap after the prediction time. Skips the times at which their centres
// cannot have come near enough.
bool OverlapOnTheWay(const Path& a, const Shape& of_a, const Path& b, const Shape& of_b) {
  const double reach = std::hypot(of_a.ahead, of_a.left) + std::hypot(of_b.ahead, of_b.left);
  const double step = a.longest_step + b.longest_step;
  const size_t times = a.placements.size();
  for (size_t t = 1; t < times;) {
    const Point2 apart = Difference(a.placements[t].centre, b.placements[t].centre);
    const double gap = std::sqrt(Dot(apart, apart)) - reach;
    if (gap > 0.0) {
      const double steps = std::floor(gap / step);
      if (!(steps < static_cast<double>(times))) return false;
      t += 1 + static_cast<size_t>(steps);
      continue;
    }
    if (Overlap(a.placements[t], of_a, b.placements[t], of_b)) return true;
    ++t;
  }
  return false;
}

// Centres from the prediction time to the last waypoint, world.
std::vector<Point2> Centres(const scene::Pose2& X_WT, const Eigen::Ref<const Trajectory>& mean,
                            int steps) {
  std::vector<Point2> centres = {{X_WT.x(), X_WT.y()}};
  Point2 from;
  for (Eigen::Index t = 0; t < mean.rows(); ++t) {
    const Point2 to{mean(t, 0), mean(t, 1)};
    for (int i = 1; i <= steps; ++i) {
      const double share = static_cast<double>(i) / steps;
      centres.push_back(X_WT *
                        Point2{from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)});
    }
    from = to;
  }
  return centres;
}

Path FindPath(const scene::Pose2& X_WT, const Eigen::Ref<const Trajectory>& mean,
              double waypoint_interval) {
  // A hair less: 0.3 s are three steps of 0.1 s.
  const int steps =
      std::max(1, static_cast<int>(std::ceil(waypoint_interval / kLongestStep - 1e-6)));
  const double step = waypoint_interval / steps;
  const auto reach = static_cast<size_t>(std::max(1L, std::lround(kHeadingReach / step)));
  const std::vector<Point2> centres = Centres(X_WT, mean, steps);
  Path path;
  Point2 direction{X_WT.cosine(), X_WT.sine()};
  for (size_t t = 0; t < centres.size(); ++t) {
    if (t > 0) {
      const Point2 moved = Difference(centres[std::min(t + reach, centres.size() - 1)],
                                      centres[t < reach ? 0 : t - reach]);
      const double distance = std::sqrt(Dot(moved, moved));
      if (distance >= kHeadingDistance) direction = {moved.x / distance, moved.y / distance};
      const Point2 last = Difference(centres[t], centres[t - 1]);
      path.longest_step = std::max(path.longest_step, std::sqrt(Dot(last, last)));
    }
    path.placements.push_back({centres[t], direction});
  }
  return path;
}

// The targets by ascending id, and which of their actions go together.
class Conflicts {
 public:
  //   order: indices of the targets, by ascending id
  Conflicts(std::span<const JointTarget> targets, std::span<const size_t> order,
            double waypoint_interval) {
    std::array<std::vector<Path>, kMostJointTargets> paths;
    std::array<Shape, kMostJointTargets> shapes;
    for (size_t i = 0; i < order.size(); ++i) {
      const JointTarget& target = targets[order[i]];
      shapes[i] = {target.length / 2.0, target.width / 2.0};
      for (size_t a = 0; a < target.actions.size(); ++a) {
        paths[i].push_back(FindPath(target.X_WT, target.means[a], waypoint_interval));
      }
    }
    for (auto& of_target : together_) {
      for (auto& of_action : of_target) of_action.fill(static_cast<ActionMask>(-1));
    }
    for (size_t i = 0; i < order.size(); ++i) {
      for (size_t j = i + 1; j < order.size(); ++j) {
        if (paths[i].empty() || paths[j].empty()) continue;
        if (Overlap(paths[i][0].placements[0], shapes[i], paths[j][0].placements[0], shapes[j])) {
          continue;
        }
        for (size_t a = 0; a < paths[i].size(); ++a) {
          for (size_t b = 0; b < paths[j].size(); ++b) {
            if (!OverlapOnTheWay(paths[i][a], shapes[i], paths[j][b], shapes[j])) continue;
            together_[i][a][j] &= static_cast<ActionMask>(~(1U << b));
            together_[j][b][i] &= static_cast<ActionMask>(~(1U << a));
            const double both = std::exp(targets[order[i]].log_probabilities[a] +
                                         targets[order[j]].log_probabilities[b]);
            probability_[i] += both;
            probability_[j] += both;
          }
        }
      }
    }
  }

  // The actions of target j that do not overlap with action a of target i.
  ActionMask Together(size_t i, size_t a, size_t j) const { return together_[i][a][j]; }
  // The probability that target i would overlap with another one, summed over the others.
  double Probability(size_t i) const { return probability_[i]; }

 private:
  std::array<std::array<std::array<ActionMask, kMostJointTargets>, kMostJointActions>,
             kMostJointTargets>
      together_;
  std::array<double, kMostJointTargets> probability_ = {};
};

// Some targets have one action left, those that are fixed; the others, all that go with these.
struct State {
  double bound = 0.0;
  size_t fixed = 0;
  std::array<ActionMask, kMostJointTargets> left = {};

  // Whether `b` leaves the queue before `a`. Of equal bounds the most complete goes first, so that
  // ties do not have to be searched in full.
  friend bool operator<(const State& a, const State& b) {
    if (a.bound != b.bound) return a.bound < b.bound;
    if (a.fixed != b.fixed) return a.fixed < b.fixed;
    return a.left > b.left;
  }
};

// Targets are numbered by ascending id, so that sums and ties do not depend on the caller's order.
class Search {
 public:
  Search(std::span<const JointTarget> targets, std::span<const size_t> order,
         const Conflicts& conflicts)
      : conflicts_(conflicts), count_(order.size()) {
    State start;
    for (size_t i = 0; i < count_; ++i) {
      log_probabilities_[i] = targets[order[i]].log_probabilities;
      start.left[i] = static_cast<ActionMask>((1U << log_probabilities_[i].size()) - 1U);
      fixing_[i] = i;
    }
    // Those that are most often in the way first: their conflicts then count in all bounds.
    std::stable_sort(
        fixing_.begin(), fixing_.begin() + static_cast<std::ptrdiff_t>(count_),
        [&](size_t a, size_t b) { return conflicts.Probability(a) > conflicts.Probability(b); });
    Push(start);
  }

  // Whether there is no other combination.
  bool Ended() const { return queue_.empty(); }
  // Whether the best state is a combination: no other one is better.
  bool Found() const { return queue_.top().fixed == count_; }

  State Take() {
    const State state = queue_.top();
    queue_.pop();
    return state;
  }

  // Replaces the best state by those that fix one more target.
  void Expand() {
    const State state = Take();
    const size_t i = fixing_[state.fixed];
    for (ActionMask left = state.left[i]; left != 0; left &= static_cast<ActionMask>(left - 1)) {
      const auto a = static_cast<size_t>(std::countr_zero(left));
      State next = state;
      next.left[i] = static_cast<ActionMask>(1U << a);
      ++next.fixed;
      for (size_t n = next.fixed; n < count_; ++n) {
        next.left[fixing_[n]] &= conflicts_.Together(i, a, fixing_[n]);
      }
      Push(next);
    }
  }

 private:
  void Push(State state) {
    state.bound = 0.0;
    for (size_t i = 0; i < count_; ++i) {
      if (state.left[i] == 0) return;
      state.bound += log_probabilities_[i][static_cast<size_t>(std::countr_zero(state.left[i]))];
    }
    queue_.push(state);
  }

  const Conflicts& conflicts_;
  const size_t count_;
  std::array<std::span<const double>, kMostJointTargets> log_probabilities_;
  std::array<size_t, kMostJointTargets> fixing_ = {};  // the order in which targets are fixed
  std::priority_queue<State> queue_;
};

void SetWeights(std::vector<JointCombination>* combinations) {
  double sum = 0.0;
  for (JointCombination& each : *combinations) {
    // Relative to the first, so that none underflows with all others.
    each.weight = std::exp(each.log_probability - combinations->front().log_probability);
    sum += each.weight;
  }
  for (JointCombination& each : *combinations) each.weight /= sum;
}

}  // namespace

std::vector<int> JointActions(const Eigen::VectorXd& probabilities) {
  std::vector<int> actions = RepresentativeCandidates(probabilities);
  std::ranges::stable_sort(actions,
                           [&](int a, int b) { return probabilities[a] > probabilities[b]; });
  actions.resize(std::min(actions.size(), kMostJointActions));
  return actions;
}

JointCombinations CombineActions(std::span<const JointTarget> targets, double waypoint_interval,
                                 int count, int most_steps) {
  JointCombinations answer;
  if (targets.empty()) return answer;
  std::vector<size_t> order(targets.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::sort(order, {}, [&](size_t i) { return targets[i].id; });
  const Conflicts conflicts(targets, order, waypoint_interval);
  Search search(targets, order, conflicts);
  int steps = 0;
  while (!search.Ended() && answer.combinations.size() < static_cast<size_t>(count)) {
    if (!search.Found()) {
      if (steps++ == most_steps) {
        answer.truncated = true;
        break;
      }
      search.Expand();
      continue;
    }
    const State state = search.Take();
    JointCombination& found = answer.combinations.emplace_back();
    found.log_probability = state.bound;
    found.actions.resize(targets.size());
    for (size_t i = 0; i < order.size(); ++i) {
      const auto a = static_cast<size_t>(std::countr_zero(state.left[i]));
      found.actions[order[i]] = targets[order[i]].actions[a];
    }
  }
  SetWeights(&answer.combinations);
  return answer;
}

}  // namespace maneuver::inference
