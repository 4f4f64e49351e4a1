#include "model/tags/tagger.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "model/evaluation/baselines.h"
#include "model/evaluation/displacement.h"
#include "model/scene/duration.h"
#include "model/scene/road_map.h"
#include "model/scene/target_frame.h"

namespace maneuver::tags {
namespace {

constexpr size_t kBatch = 8;  // windows at a time
constexpr double kLeastProbability = 1e-30;
constexpr double kWorthWriting = 0.01;  // q(y|x,s)

inference::Trajectory ToTrajectory(const std::vector<float>& values) {
  inference::Trajectory trajectory(static_cast<Eigen::Index>(values.size() / 2), 2);
  std::ranges::copy(values, trajectory.data());
  return trajectory;
}

std::string ResponsibilitiesText(const Eigen::VectorXd& responsibilities) {
  std::vector<int> order;
  for (int action = 0; action < responsibilities.size(); ++action) {
    if (responsibilities[action] >= kWorthWriting) order.push_back(action);
  }
  std::ranges::stable_sort(order, std::greater(), [&](int a) { return responsibilities[a]; });
  std::string text;
  for (const int action : order) {
    absl::StrAppendFormat(&text, "%s%d:%.4f", text.empty() ? "" : " ", action,
                          responsibilities[action]);
  }
  return text;
}

}  // namespace

// What the model says of one window.
struct Tagger::Window {
  int64_t target = 0;
  v1::AgentType type = v1::AGENT_TYPE_UNSPECIFIED;
  double time = 0.0;
  scene::Pose2 X_WT;
  double speed = 0.0;
  int action = 0;
  Eigen::VectorXd responsibilities;
  double probability = 0.0;  // of the action
  int likeliest = 0;
  double ade = 0.0;
  double fde = 0.0;
  // Of the action's mean, target frame, metres.
  Eigen::RowVector2d mid;
  Eigen::RowVector2d end;
};

Tagger::Tagger(std::shared_ptr<const inference::ActionModel> model, TaggerOptions options)
    : model_(std::move(model)),
      options_(std::move(options)),
      stride_(scene::ToSeconds(options_.examples.stride())),
      session_(model_->NewSession()),
      reader_(model_->spec()),
      inputs_(kBatch, reader_.NewInputs()),
      encodings_(kBatch) {}

std::vector<CsvRow> Tagger::Tag(const v1::Scenario& recording) {
  const std::vector<Window> windows = TagWindows(recording);
  std::vector<CsvRow> rows;
  const Window* const end = windows.data() + windows.size();
  for (const Window* first = windows.data(); first != end;) {
    const Window* last = first;
    const auto continues = [&](const Window& next) {
      return options_.merged && next.target == last->target && next.action == last->action &&
             next.time - last->time < 1.5 * stride_;
    };
    while (last + 1 != end && continues(last[1])) ++last;
    rows.push_back(RowOf(first, last + 1));
    first = last + 1;
  }
  return rows;
}

std::vector<Tagger::Window> Tagger::TagWindows(const v1::Scenario& recording) {
  std::vector<data::Example> examples =
      data::EnumerateExamples(recording, 0, model_->spec(), options_.examples);
  std::ranges::stable_sort(examples, {}, &data::Example::target_id);
  const scene::RoadMap map = scene::RoadMap::Over(recording.map_features());
  std::vector<Window> windows;
  windows.reserve(examples.size());
  for (size_t begin = 0; begin < examples.size(); begin += kBatch) {
    const std::span<const data::Example> batch =
        std::span(examples).subspan(begin, std::min(kBatch, examples.size() - begin));
    std::vector<inference::SceneInputsView> scenes;
    for (size_t i = 0; i < batch.size(); ++i) {
      reader_.Read(recording, map, batch[i].time, batch[i].target_id, batch[i].X_WT, &inputs_[i]);
      scenes.push_back(inference::ViewOf(inputs_[i]));
    }
    session_->Encode(scenes, std::span(encodings_).first(batch.size()));
    for (size_t i = 0; i < batch.size(); ++i) {
      windows.push_back(TagWindow(recording, batch[i], encodings_[i]));
    }
  }
  return windows;
}

Tagger::Window Tagger::TagWindow(const v1::Scenario& recording, const data::Example& example,
                                 const inference::SceneEncoding& encoding) {
  const v1::Agent& agent = *scene::FindAgent(recording, example.target_id);
  const inference::Trajectory driven = ToTrajectory(example.trajectory);
  Window window;
  window.target = example.target_id;
  window.type = agent.type();
  window.time = example.time;
  window.X_WT = example.X_WT;
  window.speed = evaluation::MotionAt(agent, example.time).speed();
  window.responsibilities = session_->Classify(encoding, driven).responsibilities;
  window.responsibilities.maxCoeff(&window.action);
  window.probability = encoding.probabilities[window.action];
  encoding.probabilities.maxCoeff(&window.likeliest);
  const inference::TrajectorySet means = session_->MeanTrajectories(
      encoding, std::array{window.likeliest, window.action}, inference::LatentSource::kPosterior);
  const evaluation::DisplacementErrors errors = evaluation::ErrorsOf(means[0], driven);
  window.ade = errors.min_ade;
  window.fde = errors.min_fde;
  const auto taken = means[1];
  window.mid = taken.row((taken.rows() - 1) / 2);
  window.end = taken.row(taken.rows() - 1);
  return window;
}

CsvRow Tagger::RowOf(const Window* begin, const Window* end) const {
  const auto count = static_cast<double>(end - begin);
  const auto mean = [&](double Window::*value) {
    double sum = 0.0;
    for (const Window* window = begin; window != end; ++window) sum += window->*value;
    return sum / count;
  };
  const Window& peak = *std::min_element(
      begin, end, [](const Window& a, const Window& b) { return a.probability < b.probability; });
  Eigen::VectorXd responsibilities = Eigen::VectorXd::Zero(begin->responsibilities.size());
  for (const Window* window = begin; window != end; ++window) {
    responsibilities += window->responsibilities / count;
  }
  CsvRow row;
  const auto set = [&row](Column column, double number) {
    row.row[column] = ToInteger(column, number);
  };
  row.row[Column::kTarget] = begin->target;
  row.row[Column::kClass] = begin->type;
  set(Column::kFrom, begin->time);
  set(Column::kTo, end[-1].time);
  row.row[Column::kWindows] = end - begin;
  row.row[Column::kAction] = begin->action;
  set(Column::kResponsibility, responsibilities[begin->action]);
  set(Column::kProbability, mean(&Window::probability));
  set(Column::kSurprise, -std::log(std::max(peak.probability, kLeastProbability)));
  set(Column::kPeak, peak.time);
  row.row[Column::kLikeliest] = peak.likeliest;
  set(Column::kAde, mean(&Window::ade));
  set(Column::kFde, mean(&Window::fde));
  set(Column::kSpeed, begin->speed);
  set(Column::kX, begin->X_WT.x());
  set(Column::kY, begin->X_WT.y());
  set(Column::kHeading, std::remainder(begin->X_WT.heading(), 2.0 * std::numbers::pi));
  set(Column::kMidX, peak.mid.x());
  set(Column::kMidY, peak.mid.y());
  set(Column::kEndX, peak.end.x());
  set(Column::kEndY, peak.end.y());
  row.responsibilities = ResponsibilitiesText(responsibilities);
  return row;
}

}  // namespace maneuver::tags
