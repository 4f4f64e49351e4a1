// Measures what one core of this machine can do, for comparison with the engine's times.

#ifndef MANEUVER_TESTS_BENCH_YARDSTICKS_H_
#define MANEUVER_TESTS_BENCH_YARDSTICKS_H_

#include <memory>
#include <string>

namespace maneuver::bench {

class Yardsticks {
 public:
  // Prepares the buffers.
  //   bytes: size of each buffer that memory is measured with; more than the processor's caches
  explicit Yardsticks(size_t bytes);
  ~Yardsticks();

  // Multiply square matrices by oneDNN, on the calling thread only.
  void MultiplyF32();
  void MultiplyBf16();  // only where inference::ProcessorHasBf16()
  // A multiplication and an addition count as two operations.
  static double operations();  // of one product

  void Read();  // bytes()
  void Copy();  // reads bytes() and writes as many
  double bytes() const;

 private:
  struct Buffers;
  std::unique_ptr<Buffers> buffers_;
};

// Returns the processor's name as the system states it: "AMD EPYC ...".
std::string ProcessorName();

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_YARDSTICKS_H_
