// Tells the kernel which threads may wait.

#ifndef MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_
#define MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_

#include <atomic>
#include <cstddef>
#include <memory>

namespace maneuver::machine {

// Adds `more` to the niceness of the calling thread, and of no other, up to the limit of 19. The
// kernel runs the nicest threads last.
void AddNiceness(int more);

// A group of threads that only pass work on to computing threads. When such a thread is woken, it
// normally interrupts the thread that computes on its core, does little and sleeps again. If every
// step of an answer wakes it, it does so up to ten times per answer. While the group is patient
// (SCHED_BATCH), its threads wait until the core is free or until the kernel's next tick, and then
// do all their work at once. That pays only while more work waits than can be computed.
//
// Thread-safe. A thread may be in several groups; the latest call of SetPatient counts.
class PassingThreads {
 public:
  PassingThreads();
  PassingThreads(const PassingThreads&) = delete;
  PassingThreads& operator=(const PassingThreads&) = delete;
  // Makes the threads impatient again.
  ~PassingThreads();

  // Adds the calling thread until it ends. Cheap if it is a member already.
  void Join();

  // Makes the threads patient or impatient. Cheap if they are so already.
  void SetPatient(bool patient);

  // Returns the number of threads in the group.
  size_t size() const;

 private:
  struct Members;
  struct Memberships;

  const std::shared_ptr<Members> members_;
};

}  // namespace maneuver::machine

#endif  // MANEUVER_MODEL_MACHINE_THREAD_PRIORITY_H_
