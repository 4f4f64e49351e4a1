// Which scenes a report shows.

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
// The first three have a fifth each, and at most two scenes of one recording. A scene has each group
// that it belongs to, and comes once.
std::vector<Scene> ChooseScenes(std::vector<Scene> scenes, int most);

}  // namespace maneuver::report

#endif  // MANEUVER_CLIENT_REPORT_SCENE_CHOICE_H_
