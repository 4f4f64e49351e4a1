// Chooses the scenes that a report shows.

#ifndef MANEUVER_CLIENT_REPORT_SCENE_CHOICE_H_
#define MANEUVER_CLIENT_REPORT_SCENE_CHOICE_H_

#include <vector>

#include "client/report/report_data.h"

namespace maneuver::report {

// Fills in ade_1, min_ade_6 and surprise from truth, prediction and responsibilities.
//   scene: prediction.distributions are those of the six most probable actions, or more, most
//     probable first, with as many waypoints as the truth.
void Measure(Scene* scene);

// Chooses at most `most` of the measured scenes and orders them by group:
//   worst       the largest min_ade_6
//   best        the smallest ade_1, of targets that go at least 10 m
//   surprising  the largest surprise
//   typical     of each kinematic class, in turn, the scenes whose ade_1 is nearest to its median
// Each of the first three groups gets a fifth of `most`, with at most two scenes of one recording.
// A scene appears once, with all groups that it belongs to.
std::vector<Scene> ChooseScenes(std::vector<Scene> scenes, int most);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_SCENE_CHOICE_H_
