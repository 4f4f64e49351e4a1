// Converts the parts of a training run to the tensors of a checkpoint and back.

#ifndef MANEUVER_MODEL_LEARNING_CHECKPOINT_CONTENTS_H_
#define MANEUVER_MODEL_LEARNING_CHECKPOINT_CONTENTS_H_

#include <string>

#include "checkpoint.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/learning/networks.h"
#include "model/learning/optimizer.h"
#include "model/learning/tensors.h"

namespace maneuver::learning {

// Returns the text that identifies a training run: its settings without the number of threads. A
// run may go on with another number, and then rounds differently.
std::string IdentifyingSettings(v1::TrainingSettings settings);

std::string RandomState(const at::Generator& generator);
void RestoreRandomState(const std::string& state, at::Generator* generator);

StoredTensor StoreTensor(const at::Tensor& tensor);
at::Tensor RestoreTensor(const StoredTensor& stored);

void StoreNetworks(const Networks& networks, Checkpoint* checkpoint);
void RestoreNetworks(const Checkpoint& checkpoint, Networks* networks);

// Adds more networks to the checkpoint, with `prefix` before their names.
void StoreSnapshot(const Networks::Snapshot& snapshot, const std::string& prefix,
                   Checkpoint* checkpoint);
// Returns the tensors whose names begin with `prefix`, under the rest of their names.
Networks::Snapshot StoredNetworks(const Checkpoint& checkpoint, const std::string& prefix);

void StoreOptimizer(const AdamW& optimizer, Checkpoint* checkpoint);
// Restores an optimizer, which must have the parameters of the stored one.
void RestoreOptimizer(const Checkpoint& checkpoint, AdamW* optimizer);

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_CHECKPOINT_CONTENTS_H_
