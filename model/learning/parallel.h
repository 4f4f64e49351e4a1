// Private to learning/: at::parallel_for. A source that is compiled without OpenMP would silently
// run it on one thread.

#ifndef MANEUVER_MODEL_LEARNING_PARALLEL_H_
#define MANEUVER_MODEL_LEARNING_PARALLEL_H_

#include <ATen/Parallel.h>

#ifndef INTRA_OP_PARALLEL
#error "compile this with OpenMP: at::parallel_for would use one thread"
#endif

#endif  // MANEUVER_MODEL_LEARNING_PARALLEL_H_
