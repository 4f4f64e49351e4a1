#include "client/report/scene_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <string>
#include <utility>

namespace maneuver::report {
namespace {

constexpr int kBestOf = 6;
constexpr double kMoves = 10.0;  // metres
constexpr int kOfOneRecording = 2;
constexpr double kLeastProbability = 1e-9;  // a surprise stays finite

// Mean distance over the waypoints, metres.
double Error(const v1::Trajectory& mean, const v1::Trajectory& truth) {
  const int waypoints = std::min({mean.x_size(), mean.y_size(), truth.x_size(), truth.y_size()});
  if (waypoints == 0) return std::numeric_limits<double>::infinity();
  double sum = 0.0;
  for (int t = 0; t < waypoints; ++t) {
    sum += std::hypot(mean.x(t) - truth.x(t), mean.y(t) - truth.y(t));
  }
  return sum / waypoints;
}

double Distance(const Scene& scene) {
  if (scene.truth.x().empty() || scene.truth.y().empty()) return 0.0;
  return std::hypot(*scene.truth.x().rbegin(), *scene.truth.y().rbegin());
}

// Scenes by index, each once, with the groups that they were taken for.
class Choice {
 public:
  Choice(std::vector<Scene>* scenes, size_t most) : scenes_(*scenes), most_(most) {}

  // Takes up to `count` of the scenes with the largest values for a group. Infinitely small ones
  // are not candidates.
  template <typename Value>
  void TakeLargest(const std::string& group, int count, Value value) {
    std::vector<size_t> order(scenes_.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(
        order, [&](size_t a, size_t b) { return value(scenes_[a]) > value(scenes_[b]); });
    std::map<const v1::Scenario*, int> of_recording;
    for (const size_t index : order) {
      if (count == 0 || std::isinf(value(scenes_[index]))) return;
      if (of_recording[scenes_[index].recording.get()] == kOfOneRecording) continue;
      if (!Take(index, group)) continue;
      ++of_recording[scenes_[index].recording.get()];
      --count;
    }
  }

  // False if there is no room for one more.
  bool Take(size_t index, const std::string& group) {
    const bool is_new = std::ranges::find(chosen_, index) == chosen_.end();
    if (is_new && chosen_.size() == most_) return false;
    if (is_new) chosen_.push_back(index);
    scenes_[index].groups.push_back(group);
    return true;
  }

  bool Has(size_t index) const { return std::ranges::find(chosen_, index) != chosen_.end(); }
  bool IsFull() const { return chosen_.size() == most_; }

  std::vector<Scene> Scenes() {
    std::vector<Scene> scenes;
    for (const size_t index : chosen_) scenes.push_back(std::move(scenes_[index]));
    return scenes;
  }

 private:
  std::vector<Scene>& scenes_;
  const size_t most_;
  std::vector<size_t> chosen_;
};

// The scenes of each class, those nearest to the class's median error first.
std::map<std::string, std::vector<size_t>> ByClass(const std::vector<Scene>& scenes) {
  std::map<std::string, std::vector<size_t>> classes;
  for (size_t i = 0; i < scenes.size(); ++i) classes[scenes[i].kinematic_class].push_back(i);
  for (auto& [name, members] : classes) {
    std::ranges::stable_sort(members, {}, [&](size_t i) { return scenes[i].ade_1; });
    const double median = scenes[members[members.size() / 2]].ade_1;
    std::ranges::stable_sort(members, {},
                             [&](size_t i) { return std::abs(scenes[i].ade_1 - median); });
  }
  return classes;
}

void TakeTypical(const std::vector<Scene>& scenes, Choice* choice) {
  const auto classes = ByClass(scenes);
  bool more = true;
  for (size_t turn = 0; more && !choice->IsFull(); ++turn) {
    more = false;
    for (const auto& [name, members] : classes) {
      if (turn >= members.size()) continue;
      more = true;
      // One that was taken already stands for its class once; later turns want others.
      if (turn == 0 || !choice->Has(members[turn])) choice->Take(members[turn], "typical");
    }
  }
}

}  // namespace

void Measure(Scene* scene) {
  double least = std::numeric_limits<double>::infinity();
  const int known = std::min(kBestOf, scene->prediction.distributions_size());
  for (int rank = 0; rank < known; ++rank) {
    const double error =
        Error(scene->prediction.distributions(rank).mean_trajectory(), scene->truth);
    if (rank == 0) scene->ade_1 = error;
    least = std::min(least, error);
  }
  scene->min_ade_6 = least;
  const auto was = std::ranges::max_element(scene->responsibilities);
  const auto action = static_cast<int>(was - scene->responsibilities.begin());
  if (action >= scene->prediction.probabilities_size()) return;
  scene->surprise = -std::log(std::max(kLeastProbability, scene->prediction.probabilities(action)));
}

std::vector<Scene> ChooseScenes(std::vector<Scene> scenes, int most) {
  const int share = most / 5;
  Choice choice(&scenes, static_cast<size_t>(most));
  choice.TakeLargest("worst", share, [](const Scene& scene) { return scene.min_ade_6; });
  choice.TakeLargest("best", share, [](const Scene& scene) {
    return Distance(scene) >= kMoves ? -scene.ade_1 : -std::numeric_limits<double>::infinity();
  });
  choice.TakeLargest("surprising", share, [](const Scene& scene) { return scene.surprise; });
  TakeTypical(scenes, &choice);
  return choice.Scenes();
}

}  // namespace maneuver::report
