// Private to plot/: the layers of a scene below and above the predictions.

#ifndef MANEUVER_CLIENT_PLOT_SCENE_LAYERS_H_
#define MANEUVER_CLIENT_PLOT_SCENE_LAYERS_H_

#include <vector>

#include "client/plot/axes.h"
#include "client/plot/canvas.h"
#include "maneuver/v1/scenario.pb.h"
#include "model/scene/lane_paths.h"
#include "model/scene/pose2.h"

namespace maneuver::plot {

// The position of a target's panel, and of the world within it.
struct ScenePanel {
  const v1::Scenario* scenario;
  scene::Pose2 X_WT;  // where the axes begin: the target at the prediction time, or a middle
  Axes axes;

  Pixel FromWorld(double x, double y) const {
    const scene::Point2 p_TP = X_WT.ToLocal({x, y});
    return axes.ToPixel(p_TP.x, p_TP.y);
  }
};

// Colours on the dark ground.
inline constexpr Color kGround = {22, 24, 29};
inline constexpr Color kLane = {104, 108, 116};
inline constexpr Color kRoadLine = {66, 69, 76};
inline constexpr Color kRoadEdge = {84, 80, 74};
inline constexpr Color kArea = {150, 160, 180};
inline constexpr Color kOtherAgent = {226, 60, 54};
inline constexpr Color kTarget = {255, 214, 10};
inline constexpr Color kLanePath = {64, 196, 188};
inline constexpr Color kTruth = {255, 255, 255};
inline constexpr Color kText = {222, 224, 228};
inline constexpr Color kFaintText = {150, 153, 160};

// Returns the index of the agent's latest state at or before the prediction time, at most half a
// second old; -1 if there is none.
int StateNow(const v1::Agent& agent, double prediction_time);

void DrawMap(const ScenePanel& panel, Canvas* canvas);
void DrawSignals(const ScenePanel& panel, Canvas* canvas);
// Draws lane paths with arrowheads at their ends, and the signals and stop signs along them.
void DrawLanePaths(const ScenePanel& panel, const std::vector<scene::LanePath>& paths,
                   Canvas* canvas);
// Draws rings around the leaders on the paths.
void DrawLeaders(const ScenePanel& panel, const std::vector<scene::LanePath>& paths,
                 Canvas* canvas);
// Draws all agents except `target_id`, with their past second.
void DrawOtherAgents(const ScenePanel& panel, int64_t target_id, Canvas* canvas);
void DrawTarget(const ScenePanel& panel, const v1::Agent& target, Canvas* canvas);

// Returns a line from an agent's present state through the states of the next `horizon` seconds
// (0: of all seconds). Empty if the agent is absent now or has no later state.
Line TruthLine(const ScenePanel& panel, const v1::Agent& agent, double horizon);

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_SCENE_LAYERS_H_
