#include "model/kernels/kernel_choice.h"

#include <hwy/targets.h>

#include <cstdint>

namespace maneuver::kernels {
namespace {

constexpr char kPlainName[] = "plain";

// Returns the targets that this processor has, one bit each, the best one first.
const std::vector<int64_t>& Targets() {
  static const std::vector<int64_t> targets = hwy::SupportedAndGeneratedTargets();
  return targets;
}

// Makes Highway choose among `targets`.
void RestrictTargets(int64_t targets) {
  hwy::SetSupportedTargetsForTest(targets);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

}  // namespace

void ChooseKernels(KernelChoice choice) { plain_kernels_chosen = choice == KernelChoice::kPlain; }

std::string KernelTarget() {
  if (UsesPlainKernels()) return kPlainName;
  return hwy::TargetName(hwy::SupportedAndGeneratedTargets().front());
}

std::vector<std::string> KernelTargets() {
  std::vector<std::string> names = {kPlainName};
  for (const int64_t target : Targets()) names.emplace_back(hwy::TargetName(target));
  return names;
}

void ForceKernelTargetForTest(const std::string& target) {
  ChooseKernels(target == kPlainName ? KernelChoice::kPlain : KernelChoice::kAuto);
  for (const int64_t each : Targets()) {
    if (hwy::TargetName(each) == target) RestrictTargets(each);
  }
}

}  // namespace maneuver::kernels
