// The parts of a run that a checkpoint holds, as tensors.

#ifndef MANEUVER_MODEL_LEARNING_RUN_STATE_H_
#define MANEUVER_MODEL_LEARNING_RUN_STATE_H_

#include <string>

#include "checkpoint.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/optimizer.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// What tells one run from another: its settings without the threads, which do not change what is
// learned from.
std::string RunSettings(v1::TrainingSettings settings);

std::string RandomState(const at::Generator& generator);
void RestoreRandomState(const std::string& state, at::Generator* generator);

StoredTensor StoreTensor(const at::Tensor& tensor);
at::Tensor RestoreTensor(const StoredTensor& stored);

void StoreNetworks(const Networks& networks, Checkpoint* checkpoint);
void RestoreNetworks(const Checkpoint& checkpoint, Networks* networks);

// More networks in the same checkpoint, their names after a prefix.
void StoreSnapshot(const Networks::Snapshot& snapshot, const std::string& prefix,
                   Checkpoint* checkpoint);
// Those with the prefix, by the rest of their names.
Networks::Snapshot StoredNetworks(const Checkpoint& checkpoint, const std::string& prefix);

void StoreOptimizer(const AdamW& optimizer, Checkpoint* checkpoint);
// Of an optimizer with the parameters of the one that was stored.
void RestoreOptimizer(const Checkpoint& checkpoint, AdamW* optimizer);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RUN_STATE_H_
