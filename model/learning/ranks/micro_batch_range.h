#ifndef MANEUVER_MODEL_LEARNING_RANKS_MICRO_BATCH_RANGE_H_
#define MANEUVER_MODEL_LEARNING_RANKS_MICRO_BATCH_RANGE_H_

namespace maneuver::learning {

// The micro-batches of each batch that one rank computes. Micro-batch i of m has the examples
// floor(B i / m) up to floor(B (i + 1) / m) of a batch of B; some are empty if B < m.
struct MicroBatchRange {
  int first = 0;
  int count = 1;
  int of = 1;  // m; with 1, the only micro-batch is the batch
};

// Returns the share of a rank.
//   micro_batches: a multiple of `ranks`
inline MicroBatchRange RangeOfRank(int micro_batches, int rank, int ranks) {
  const int count = micro_batches / ranks;
  return {rank * count, count, micro_batches};
}

}  // namespace maneuver::learning

#endif  // MANEUVER_MODEL_LEARNING_RANKS_MICRO_BATCH_RANGE_H_
