// Each function adds its commands to the command line. `environment` must outlive it.

#ifndef MANEUVER_CLIENT_CLI_COMMANDS_H_
#define MANEUVER_CLIENT_CLI_COMMANDS_H_

#include "client/cli/command.h"
#include "client/cli/environment.h"

namespace maneuver::cli {

void AddSynthesize(Command& root, Environment& environment);
void AddImport(Command& root, Environment& environment);
void AddDataset(Command& root, Environment& environment);
void AddScenario(Command& root, Environment& environment);
void AddTrain(Command& root, Environment& environment);
void AddEvaluate(Command& root, Environment& environment);
void AddCrossValidate(Command& root, Environment& environment);
void AddRecalibrate(Command& root, Environment& environment);
void AddJob(Command& root, Environment& environment);
void AddModel(Command& root, Environment& environment);
void AddPredict(Command& root, Environment& environment);  // probability, distribution, predict
void AddClassify(Command& root, Environment& environment);
void AddTag(Command& root, Environment& environment);
void AddTags(Command& root, Environment& environment);
void AddFind(Command& root, Environment& environment);
void AddOutcomes(Command& root, Environment& environment);
void AddLoad(Command& root, Environment& environment);
void AddHealth(Command& root, Environment& environment);
void AddLogLevel(Command& root, Environment& environment);

}  // namespace maneuver::cli

#endif  // MANEUVER_CLIENT_CLI_COMMANDS_H_
