#include "model/kernels/rescale.h"

namespace maneuver::kernels {

// The compiler vectorises both loops.
void Rescale(const float* x, int rows, int columns, const double* stddev, const double* mean,
             const double* shift, double* y) {
  for (int row = 0; row < rows; ++row, x += columns, y += columns) {
    for (int i = 0; i < columns; ++i) y[i] = double{x[i]} * stddev[i] + mean[i];
    if (shift == nullptr) continue;
    for (int i = 0; i < columns; ++i) y[i] += shift[i];
  }
}

}  // namespace maneuver::kernels
