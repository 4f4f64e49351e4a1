#include "model/machine/thread_priority.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "locks/mutex.h"

namespace maneuver::machine {
namespace {

pid_t ThisThread() { return static_cast<pid_t>(syscall(SYS_gettid)); }

// Threads that are not patient have SCHED_OTHER, the default.
void SetPolicy(pid_t thread, bool patient) {
  const sched_param none{};
  (void)sched_setscheduler(thread, patient ? SCHED_BATCH : SCHED_OTHER, &none);
}

}  // namespace

void AddNiceness(int more) {
  // On Linux, niceness belongs to the thread, not to the process.
  [[maybe_unused]] const int now = nice(more);
}

struct PassingThreads::Members {
  std::atomic<bool> patient = false;  // written under mutex

  Mutex mutex;
  std::vector<pid_t> threads ABSL_GUARDED_BY(mutex);
};

// The groups of one thread. The thread leaves them when it ends, because its id may be reused.
struct PassingThreads::Memberships {
  ~Memberships() {
    for (const auto& group : groups) {
      const MutexLock lock(group->mutex);
      std::erase(group->threads, ThisThread());
    }
  }
  std::vector<std::shared_ptr<Members>> groups;
};

PassingThreads::PassingThreads() : members_(std::make_shared<Members>()) {}

PassingThreads::~PassingThreads() { SetPatient(false); }

void PassingThreads::Join() {
  static thread_local Memberships memberships;
  if (std::ranges::find(memberships.groups, members_) != memberships.groups.end()) return;
  // Groups that no longer exist are referenced only by their threads.
  std::erase_if(memberships.groups, [](const auto& group) { return group.use_count() == 1; });
  memberships.groups.push_back(members_);
  const MutexLock lock(members_->mutex);
  members_->threads.push_back(ThisThread());
  if (members_->patient) SetPolicy(ThisThread(), true);
}

void PassingThreads::SetPatient(bool patient) {
  if (members_->patient.load(std::memory_order_relaxed) == patient) return;
  const MutexLock lock(members_->mutex);
  if (members_->patient.exchange(patient) == patient) return;
  for (const pid_t thread : members_->threads) SetPolicy(thread, patient);
}

size_t PassingThreads::size() const {
  const MutexLock lock(members_->mutex);
  return members_->threads.size();
}

}  // namespace maneuver::machine
