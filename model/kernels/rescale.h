// Takes standardised numbers back to their units.

#ifndef MANEUVER_MODEL_KERNELS_RESCALE_H_
#define MANEUVER_MODEL_KERNELS_RESCALE_H_

namespace maneuver::kernels {

// Computes y = x * stddev + mean + shift for each row, in this order, without fused operations.
//   x, y: [rows, columns];  stddev, mean: [columns];  shift: [columns], or null for none
void Rescale(const float* x, int rows, int columns, const double* stddev, const double* mean,
             const double* shift, double* y);

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_RESCALE_H_
