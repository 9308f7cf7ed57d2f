// The long vectors of L-BFGS: dot products with the stored vectors, and their combination to a direction.
//
// A problem's vectors of n numbers lie a stride apart: the point x, its gradient g, the direction d, then m steps
// s and m gradient changes y, each m a ring whose newest is at `newest`.  Numbers of stored vectors go by age, newest
// first.
#include <algorithm>
#include <vector>

#include "interface.h"
#include "vec.h"

namespace nablahog::lbfgs {

constexpr int64_t piece = 1024;      // numbers that stay in the fastest memory while all stored vectors are read
constexpr int64_t rows_at_once = 4;  // stored vectors

// Calls body.operator()<V>(k) for the numbers from k on: whole vectors first, then one by one
template <class T, class Body>
[[gnu::always_inline]] inline void for_vectors(int64_t count, Body body) {
  int64_t k = 0;
  for (; k + lanes<T> <= count; k += lanes<T>) body.template operator()<Vec<T>>(k);
  for (; k < count; ++k) body.template operator()<Vec<T, 1>>(k);
}

// Calls body.operator()<V, COUNT>(k) for COUNT vectors V of numbers from k on
template <class T, class Body>
[[gnu::always_inline]] inline void for_blocks(int64_t count, Body body) {
  constexpr int at_once = 4;
  int64_t k = 0;
  for (; k + at_once * lanes<T> <= count; k += at_once * lanes<T>) body.template operator()<Vec<T>, at_once>(k);
  for (; k < count; ++k) body.template operator()<Vec<T, 1>, 1>(k);
}

template <class T>
class DotProduct {
 public:
  [[gnu::always_inline]] void add(Vec<T> a, Vec<T> b) { lanes_ = multiply_add(a, b, lanes_); }
  [[gnu::always_inline]] void add(Vec<T, 1> a, Vec<T, 1> b) { rest_ += a[0] * b[0]; }
  T value() const { return sum(lanes_) + rest_; }

 private:
  Vec<T> lanes_{};
  T rest_ = 0;
};

template <class T>
class Largest {
 public:
  [[gnu::always_inline]] void add(Vec<T> a) { lanes_ = maximum(a, lanes_); }
  [[gnu::always_inline]] void add(Vec<T, 1> a) { rest_ = std::max(a[0], rest_); }
  T value() const {
    T largest = rest_;
    for (int k = 0; k < lanes<T>; ++k) largest = std::max(largest, lanes_[k]);
    return largest;
  }

 private:
  Vec<T> lanes_{};
  T rest_ = 0;
};

// One problem's vectors
template <class T>
struct Problem {
  T* x;
  int64_t n, stride, memory, newest;

  T* gradient() const { return x + stride; }
  T* direction() const { return x + 2 * stride; }
  T* stored(int64_t row) const { return x + (3 + row) * stride; }

  // Index among 2m numbers by age, steps first, of a stored vector
  int64_t by_age(int64_t row) const {
    const int64_t slot = row % memory;
    return row - slot + (newest - slot + memory) % memory;
  }
};

// Calls body.operator()<ROWS>(row) for the 2m stored vectors, ROWS at once
template <class Body>
void for_rows(int64_t rows, Body body) {
  int64_t row = 0;
  for (; row + rows_at_once <= rows; row += rows_at_once) body.template operator()<rows_at_once>(row);
  for (; row < rows; row += 2) body.template operator()<2>(row);
}

// To out (2m + 4): g'ᵀ·each stored vector, g'ᵀd, (g' - g)ᵀd, ‖g' - g‖², (g' - g)ᵀg' for the gradient g' at the trial
// point
template <class T>
void dots(const Problem<T>& problem, const T* trial_gradient, T* out) {
  const int64_t n = problem.n, rows = 2 * problem.memory;
  DotProduct<T> beside[4];
  for_vectors<T>(n, [&]<class V>(int64_t k) {
    const V g = load<V>(trial_gradient + k), change = g - load<V>(problem.gradient() + k);
    const V direction = load<V>(problem.direction() + k);
    beside[0].add(g, direction);
    beside[1].add(change, direction);
    beside[2].add(change, change);
    beside[3].add(change, g);
  });
  for (int j = 0; j < 4; ++j) out[rows + j] = beside[j].value();
  std::fill(out, out + rows, T(0));
  for (int64_t begin = 0; begin < n; begin += piece) {
    const int64_t count = std::min(piece, n - begin);
    for_rows(rows, [&]<int ROWS>(int64_t row) {
      DotProduct<T> products[ROWS];
      for_vectors<T>(count, [&]<class V>(int64_t k) {
        const V g = load<V>(trial_gradient + begin + k);
        NABLAHOG_UNROLL
        for (int j = 0; j < ROWS; ++j) products[j].add(g, load<V>(problem.stored(row + j) + begin + k));
      });
      for (int j = 0; j < ROWS; ++j) out[problem.by_age(row + j)] += products[j].value();
    });
  }
}

// Takes the step t·d to the trial point, where the gradient is g', and stores t·d and g' - g as the newest pair if
// asked. The new direction is the stored vectors and g' times the 2m + 1 coefficients.  Sets its slope, and the largest
// |g'_k|.
template <class T>
void take_step(const Problem<T>& problem, T step, bool stores, const T* coefficients, const T* trial_gradient, T& slope,
               T& peak) {
  const int64_t rows = 2 * problem.memory;
  T *x = problem.x, *gradient = problem.gradient(), *direction = problem.direction();
  T *s = problem.stored(problem.newest), *y = problem.stored(problem.memory + problem.newest);
  std::vector<T> by_place(rows);
  for (int64_t row = 0; row < rows; ++row) by_place[row] = coefficients[problem.by_age(row)];
  DotProduct<T> along;
  Largest<T> largest;
  for_blocks<T>(problem.n, [&]<class V, int COUNT>(int64_t begin) {
    V total[COUNT];
    NABLAHOG_UNROLL
    for (int j = 0; j < COUNT; ++j) {
      const int64_t k = begin + j * size<V>;
      const V g = load<V>(trial_gradient + k), change = g - load<V>(gradient + k),
              moved = splat<V>(step) * load<V>(direction + k);
      if (stores) {
        store<V>(s + k, moved);
        store<V>(y + k, change);
      }
      store<V>(x + k, load<V>(x + k) + moved);
      store<V>(gradient + k, g);
      total[j] = splat<V>(coefficients[rows]) * g;
      largest.add(abs(g));
    }
    for (int64_t row = 0; row < rows; ++row) {
      const V by = splat<V>(by_place[row]);
      NABLAHOG_UNROLL
      for (int j = 0; j < COUNT; ++j) {
        total[j] = multiply_add(by, load<V>(problem.stored(row) + begin + j * size<V>), total[j]);
      }
    }
    NABLAHOG_UNROLL
    for (int j = 0; j < COUNT; ++j) {
      const int64_t k = begin + j * size<V>;
      store<V>(direction + k, total[j]);
      along.add(load<V>(trial_gradient + k), total[j]);
    }
  });
  slope = along.value();
  peak = largest.value();
}

}  // namespace nablahog::lbfgs

using namespace nablahog;

namespace {

// Problem i of vectors (B, rows, stride)
template <class T>
lbfgs::Problem<T> problem(void* vectors, int64_t i, int64_t n, int64_t rows, int64_t stride, int64_t memory,
                          const int64_t* newest) {
  return {static_cast<T*>(vectors) + i * rows * stride, n, stride, memory, newest[i]};
}

}  // namespace

// Of problems start … stop - 1: vectors (B, rows, stride) of n numbers, with rings of `memory` pairs whose newest are
// at newest (B,), and gradients at trial points (B, n); to out (B, 2·memory + 4).
NABLAHOG_API int nablahog_lbfgs_dots(bool double_precision, int64_t start, int64_t stop, int64_t n, int64_t rows,
                                     int64_t stride, int64_t memory, void* vectors, const int64_t* newest,
                                     const void* trial_gradients, void* out) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      for (int64_t i = start; i < stop; ++i) {
        lbfgs::dots(problem<T>(vectors, i, n, rows, stride, memory, newest),
                    static_cast<const T*>(trial_gradients) + i * n, static_cast<T*>(out) + i * (2 * memory + 4));
      }
    });
  });
}

// The same arrays; steps (B,), of which 0 leaves a problem as it is; whether pairs are stored (B,), by which the newest
// move on; coefficients (B, 2·memory + 1); slopes and peaks (B,) of problems that move are set.
NABLAHOG_API int nablahog_lbfgs_take_step(bool double_precision, int64_t start, int64_t stop, int64_t n, int64_t rows,
                                          int64_t stride, int64_t memory, void* vectors, int64_t* newest,
                                          const void* trial_gradients, const void* steps, const bool* stores,
                                          const void* coefficients, void* slopes, void* peaks) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      for (int64_t i = start; i < stop; ++i) {
        const T step = static_cast<const T*>(steps)[i];
        if (!(step > 0)) continue;
        if (stores[i]) newest[i] = (newest[i] + 1) % memory;
        lbfgs::take_step(problem<T>(vectors, i, n, rows, stride, memory, newest), step, stores[i],
                         static_cast<const T*>(coefficients) + i * (2 * memory + 1),
                         static_cast<const T*>(trial_gradients) + i * n, static_cast<T*>(slopes)[i],
                         static_cast<T*>(peaks)[i]);
      }
    });
  });
}
