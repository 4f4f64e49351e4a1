// The protocol between the supervisor and the trainer process.
//
//   maneuver-trainer train --settings FILE --dataset FOLDER... --output FOLDER
//       [--dataset-name NAME...] [--start-from FOLDER --start-from-name NAME] [--ranks N]
//       [--threads N] [--progress json|bar|none]
//       [--checkpoints FOLDER] [--checkpoint-interval S] [--checkpoint-steps N]
//       [--checkpoints-kept N] [--least-actions N] [--data-memory BYTES]
//       [--next-model FOLDER --next-dataset FOLDER --next-settings FILE --next-count N]
//   maneuver-trainer evaluate --model FOLDER --dataset FOLDER [--output FILE]
//       [--settings FILE] [--sampled-examples N] [--data-memory BYTES] [--threads N]
//       [--progress json|bar|none]
//   maneuver-trainer cross-validate --settings FILE --dataset FOLDER... --output FILE
//       [--test-dataset NAME=FOLDER...] [--folds N] [--fold-seed N] [--seeds N,...]
//       [--models FOLDER] [--checkpoints FOLDER] [--data-memory BYTES] [--threads N]
//       [--progress json|bar|none]
//   maneuver-trainer recalibrate --model FOLDER --dataset FOLDER... --output FOLDER
//       [--model-name NAME] [--dataset-name NAME...] [--settings FILE] [--data-memory BYTES]
//       [--threads N] [--progress json|bar|none]
//   maneuver-trainer tag --model FOLDER --dataset FOLDER... --output FOLDER
//       [--part I --parts N] [--windows] [--stride S] [--room BYTES] [--checkpoints FOLDER]
//       [--threads N] [--progress json|bar|none]
//   maneuver-trainer devices
//       Prints the values of TrainingSettings.device that can be used here, one a line.
//
// Each FILE is proto3 JSON. The settings are a TrainingSettings for train and cross-validate, and
// an ExampleSettings for evaluate, recalibrate and --next-settings. --next-... describe the
// evaluations that follow a training, so that its progress counts them. The output of evaluate is
// an EvaluationReport, that of cross-validate a CrossValidationReport; train and recalibrate write
// a model folder.
// With --progress json each line on standard output is one JobProgress as proto3 JSON. evaluate and
// cross-validate then need --output; otherwise they print the report for people. Standard error is
// for people, and its last line says why a run failed. SIGTERM stops a run; no half-written file
// remains.
//
// If the folder of --checkpoints has checkpoints of the same run, the run continues from the latest
// one. A checkpoint is a file checkpoint-NUMBER, written in one step; numbers only grow. On SIGTERM
// the run writes a last checkpoint. Checkpoints stay when the run is over. In a cross-validation,
// each measured model is a checkpoint; a model whose learning was interrupted is learned again. tag
// continues with the shards that are not complete in its output; its checkpoints only count shards.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_
#define MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_

namespace maneuver::jobs {

// Exit statuses of the trainer. They follow sysexits.h where it has a fitting one.
enum class TrainerExit {
  kOk = 0,
  kInvalidSettings = 64,  // EX_USAGE: settings or flags
  kUnusableData = 65,     // EX_DATAERR: a damaged dataset
  kNotEnough = 66,        // EX_NOINPUT: not enough examples
  kInternal = 70,         // EX_SOFTWARE
  kOutOfMemory = 71,      // EX_OSERR
  kDiskFull = 73,         // EX_CANTCREAT
  kCannotWrite = 74,      // EX_IOERR: no permission, something in the way
  kDiverged = 80,         // the loss is no longer finite
  kCollapsed = 81,        // to fewer actions than --least-actions
  kNotFinite = 82,        // a metric of the evaluation
  kRankLost = 83,         // another rank ended or did not answer; start all again
  kNoRoom = 84,           // the output would have more bytes than --room
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_
