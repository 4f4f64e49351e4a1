#include "model/learning/checkpoint_contents.h"

#include <cstring>

namespace maneuver::learning {

StoredTensor StoreTensor(const at::Tensor& tensor) {
  const at::Tensor values = tensor.detach().to(at::kCPU, at::kFloat).contiguous();
  StoredTensor stored;
  for (const int64_t size : values.sizes()) stored.add_shape(size);
  stored.set_values(values.data_ptr<float>(), static_cast<size_t>(values.numel()) * sizeof(float));
  return stored;
}

at::Tensor RestoreTensor(const StoredTensor& stored) {
  at::Tensor values =
      at::empty(std::vector<int64_t>(stored.shape().begin(), stored.shape().end()), at::kFloat);
  TORCH_CHECK(stored.values().size() == static_cast<size_t>(values.numel()) * sizeof(float),
              "a tensor of the checkpoint has ", stored.values().size(), " bytes");
  std::memcpy(values.data_ptr<float>(), stored.values().data(), stored.values().size());
  return values;
}

std::string IdentifyingSettings(v1::TrainingSettings settings) {
  settings.clear_threads();
  return settings.SerializeAsString();
}

std::string RandomState(const at::Generator& generator) {
  const at::Tensor state = generator.get_state();
  return {reinterpret_cast<const char*>(state.data_ptr<uint8_t>()),
          static_cast<size_t>(state.numel())};
}

void RestoreRandomState(const std::string& state, at::Generator* generator) {
  at::Tensor bytes = at::empty({static_cast<int64_t>(state.size())}, at::kByte);
  std::memcpy(bytes.data_ptr<uint8_t>(), state.data(), state.size());
  generator->set_state(bytes);
}

void StoreNetworks(const Networks& networks, Checkpoint* checkpoint) {
  StoreSnapshot(networks.Save(), "", checkpoint);
}

void StoreSnapshot(const Networks::Snapshot& snapshot, const std::string& prefix,
                   Checkpoint* checkpoint) {
  for (const auto& [name, tensor] : snapshot) {
    (*checkpoint->mutable_networks())[prefix + name] = StoreTensor(tensor);
  }
}

Networks::Snapshot StoredNetworks(const Checkpoint& checkpoint, const std::string& prefix) {
  Networks::Snapshot snapshot;
  for (const auto& [name, stored] : checkpoint.networks()) {
    if (name.compare(0, prefix.size(), prefix) == 0) {
      snapshot[name.substr(prefix.size())] = RestoreTensor(stored);
    }
  }
  return snapshot;
}

void RestoreNetworks(const Checkpoint& checkpoint, Networks* networks) {
  networks->Restore(StoredNetworks(checkpoint, ""));
}

void StoreOptimizer(const AdamW& optimizer, Checkpoint* checkpoint) {
  const AdamW::State state = optimizer.Save();
  checkpoint->set_optimizer_steps(state.steps);
  for (const at::Tensor& moment : state.moments) *checkpoint->add_moments() = StoreTensor(moment);
}

void RestoreOptimizer(const Checkpoint& checkpoint, AdamW* optimizer) {
  AdamW::State state;
  state.steps = checkpoint.optimizer_steps();
  for (const StoredTensor& moment : checkpoint.moments())
    state.moments.push_back(RestoreTensor(moment));
  optimizer->Restore(state);
}

}  // namespace maneuver::learning
