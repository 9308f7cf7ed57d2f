// The interface of the minimisers' loops.
#include "interface.h"
#include "lbfgs.h"

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
