// What the supervisor and the trainer process say to each other.
//
//   maneuver-trainer train --settings FILE --dataset FOLDER... --output FOLDER
//       [--dataset-name NAME...] [--threads N] [--progress json|bar|none]
//       [--checkpoints FOLDER] [--checkpoint-interval S] [--checkpoint-steps N]
//       [--checkpoints-kept N] [--least-actions N] [--data-memory BYTES]
//   maneuver-trainer evaluate --model FOLDER --dataset FOLDER [--output FILE]
//       [--settings FILE] [--sampled-examples N] [--data-memory BYTES] [--threads N]
//       [--progress json|bar|none]
//   maneuver-trainer cross-validate --settings FILE --dataset FOLDER... --output FILE
//       [--test-dataset NAME=FOLDER...] [--folds N] [--fold-seed N] [--seeds N,...]
//       [--models FOLDER] [--checkpoints FOLDER] [--threads N] [--progress json|bar|none]
//
// FILEs are proto3 JSON: settings is a TrainingSettings (train, cross-validate) or an
// ExampleSettings (evaluate), the output of evaluate an EvaluationReport, that of cross-validate a
// CrossValidationReport, that of train a model folder. With --progress json each line on standard
// output is one JobProgress as proto3 JSON, and evaluate and cross-validate need --output; without
// it they print the report for people. Whatever is on standard error is for people,
// its last line says why a run failed. SIGTERM stops a run; nothing half-written remains.
//
// A run that finds checkpoints of its own in the folder named by --checkpoints goes on from the
// latest one. Each is a file checkpoint-NUMBER, written in one step; numbers only grow. SIGTERM has
// a last one written. They stay when the run is over. Of a cross-validation, each model that was
// measured is a checkpoint, and a model that was being learned is learned anew.

#ifndef MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_
#define MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_

namespace maneuver::jobs {

// Exit statuses of the trainer, after sysexits where one fits.
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
};

}  // namespace maneuver::jobs

#endif  // MANEUVER_SERVER_JOBS_TRAINER_PROTOCOL_H_
