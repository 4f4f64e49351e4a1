// Mutations of inputs, from a seed: of bytes, and of the fields of a message.

#ifndef MANEUVER_TESTS_FUZZ_MUTATION_H_
#define MANEUVER_TESTS_FUZZ_MUTATION_H_

#include <google/protobuf/message.h>

#include <cstdint>
#include <string>

namespace maneuver::fuzz {

// The same numbers on each machine, by SplitMix64.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  uint64_t Next();
  // Returns a number in 0 .. count - 1; 0 if count is 0.
  uint64_t Below(uint64_t count);
  bool OneIn(uint64_t count) { return Below(count) == 0; }

 private:
  uint64_t state_;
};

// Changes, inserts, removes, repeats or cuts off some bytes. Text inputs also get digits and
// punctuation of their own in other places.
void MutateBytes(Random& random, std::string* bytes);

// Sets, clears, adds, removes, repeats or swaps a field of the message or of one inside it. Numbers
// become those that code tends to forget: NaN, infinities, the largest and smallest, limits, and
// those of the same field elsewhere.
void MutateMessage(Random& random, google::protobuf::Message* message);

}  // namespace maneuver::fuzz

#endif  // MANEUVER_TESTS_FUZZ_MUTATION_H_
