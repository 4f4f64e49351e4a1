// What one core of this machine can do, to hold the engine's times against.

#ifndef MANEUVER_TESTS_BENCH_YARDSTICKS_H_
#define MANEUVER_TESTS_BENCH_YARDSTICKS_H_

#include <memory>
#include <string>

namespace maneuver::bench {

class Yardsticks {
 public:
  //   bytes: of each buffer that memory is measured with; more than the processor's caches hold.
  explicit Yardsticks(size_t bytes);
  ~Yardsticks();

  // Products of square matrices by oneDNN, on the calling thread alone.
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

// "AMD EPYC ...", as the system names it.
std::string ProcessorName();

}  // namespace maneuver::bench

#endif  // MANEUVER_TESTS_BENCH_YARDSTICKS_H_
