// Which threads the kernel lets go first.

#ifndef MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_
#define MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_

#include <atomic>
#include <cstddef>
#include <memory>

namespace maneuver::machine {

// Makes the calling thread, and it alone, nicer than it is by so much, but no nicer than 19: who is
// nicest goes last.
void AddNiceness(int more);

// Threads that pass work on to others which compute. As a rule one that is woken interrupts
// whoever computes on its core, does its little bit and goes to sleep again: ten times an answer,
// if each answer wakes it for every step that it takes. While they are patient, these threads come
// once the core is free, or at the kernel's next tick, and then do all that there is (SCHED_BATCH).
// That is worth while only as long as more waits than can be computed.
//
// Safe to use from any thread. A thread may be in several groups; the last that was told counts.
class PassingThreads {
 public:
  PassingThreads();
  PassingThreads(const PassingThreads&) = delete;
  PassingThreads& operator=(const PassingThreads&) = delete;
  // They are patient no longer.
  ~PassingThreads();

  // Has the calling thread in it until it ends. Cheap if it is in it already.
  void Join();

  // Cheap if they are so already.
  void SetPatient(bool patient);

  // How many are in it.
  size_t size() const;

 private:
  struct Members;
  struct Memberships;

  const std::shared_ptr<Members> members_;
};

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_
