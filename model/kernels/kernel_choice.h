// Chooses which implementation the kernels run.
//
// A kernel is a function with a plain implementation, a loop that anyone can read, and a fast one.
// The fast one is written once, with Highway, and compiled for several instruction sets, called
// targets. A process runs the best target that its processor has, or the plain loops.

#ifndef MANEUVER_MODEL_KERNELS_KERNEL_CHOICE_H_
#define MANEUVER_MODEL_KERNELS_KERNEL_CHOICE_H_

#include <atomic>
#include <string>
#include <vector>

namespace maneuver::kernels {

enum class KernelChoice {
  kAuto,   // the best target of this processor
  kPlain,  // the plain loops, to rule the fast ones out in an incident
};

// Chooses for the whole process. Call it before the first model is loaded: weights are packed for
// the current choice, and layers that are already packed keep theirs.
void ChooseKernels(KernelChoice choice);

// What ChooseKernels chose. In the header, since small kernels ask for it in each call.
inline std::atomic<bool> plain_kernels_chosen = false;
inline bool UsesPlainKernels() { return plain_kernels_chosen.load(std::memory_order_relaxed); }

// Returns "plain" or the name of the target in use, such as "AVX2".
std::string KernelTarget();

// Returns all values of KernelTarget that this binary has and this processor can run, "plain" first
// and the best target next.
std::vector<std::string> KernelTargets();

// Makes the process run one of KernelTargets(). Only for tests.
void ForceKernelTargetForTest(const std::string& target);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_KERNEL_CHOICE_H_
