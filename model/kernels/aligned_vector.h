// A vector whose first element begins a cache line.

#ifndef MANEUVER_MODEL_KERNELS_ALIGNED_VECTOR_H_
#define MANEUVER_MODEL_KERNELS_ALIGNED_VECTOR_H_

#include <cstddef>
#include <new>
#include <vector>

namespace maneuver::kernels {

// The alignment, bytes: a cache line, and the widest vector register.
inline constexpr std::size_t kAlignment = 64;

template <typename T>
struct CacheLineAllocator {
  using value_type = T;

  CacheLineAllocator() = default;
  // Allocators of all types convert into each other, as std::vector wants.
  template <typename U>
  CacheLineAllocator(const CacheLineAllocator<U>& /*other*/) {}  // NOLINT

  T* allocate(std::size_t count) {
    return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t(kAlignment)));
  }
  void deallocate(T* values, std::size_t /*count*/) {
    ::operator delete(values, std::align_val_t(kAlignment));
  }
  bool operator==(const CacheLineAllocator& /*other*/) const { return true; }
};

template <typename T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

}  // namespace maneuver::kernels

#endif  // MANEUVER_MODEL_KERNELS_ALIGNED_VECTOR_H_
