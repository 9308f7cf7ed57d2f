// Eq. 7, the interface of normalisers: cells (rows, cols, bins) of one image to its descriptor (rows, cols, channels).
#pragma once

#include "dual.h"
#include "tables.h"
#include "workspace.h"

namespace nablahog {

template <class T>
class Normalizer {
 public:
  virtual ~Normalizer() = default;
  virtual void forward(const T* cells, T* out) = 0;
  virtual void vjp(const T* cells, const T* grad_out, T* grad_cells) = 0;
  // The forward pass of dual numbers; its value goes to `out.value`.
  virtual void jvp(DualPointer<const T> cells, DualPointer<T> out) = 0;
};

// Of `count` numbers, fewer than a vector or more; nothing beyond them is read.
template <class P>
[[gnu::always_inline]] inline auto dot(P left, P right, int64_t count) {
  using T = typename Pointee<P>::Number;
  typename Pointee<P>::Vector total{};
  for (int64_t k = 0; k < count; k += lanes<T>) {
    total = multiply_add(load_first(left + k, count - k), load_first(right + k, count - k), total);
  }
  return sum(total);
}

// In double precision, of long vectors: one sum in float32 would lose digits.
template <class T>
double long_dot(const T* left, const T* right, int64_t count, double total = 0) {
  for (int64_t k = 0; k < count; k += 256) total += dot(left + k, right + k, count - k < 256 ? count - k : 256);
  return total;
}

// The sum of squares of long vectors
template <class T>
double long_energy(const T* x, int64_t count) {
  return long_dot(x, x, count);
}
template <class T>
Dual<double> long_energy(DualPointer<T> x, int64_t count) {
  using N = std::remove_const_t<T>;
  return {long_dot<N>(x.value, x.value, count), 2 * long_dot<N>(x.value, x.tangent, count)};
}

// Copies `count` numbers, times a factor.
template <class P, class Q, class S>
[[gnu::always_inline]] inline void scale(P from, int64_t count, S factor, Q to) {
  if constexpr (is_dual<S>) {
    for (int64_t k = 0; k < count; ++k) put(to, k, get(from, k) * factor);
  } else {
    using N = std::remove_cvref_t<decltype(*to)>;
    for (int64_t k = 0; k < count; k += lanes<N>)
      store_first(to + k, load_first(from + k, count - k) * factor, count - k);
  }
}

}  // namespace nablahog
