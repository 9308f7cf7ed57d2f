// Each cell's histogram for itself: v / max(‖v‖, ε).
#pragma once

#include "normalizer.h"

namespace nablahog {

template <class T>
class CellNorm final : public Normalizer<T> {
 public:
  CellNorm(const nablahog_plan& plan, Workspace&)
      : epsilon_(T(plan.constants[0])), bins_(plan.bins), cells_(plan.rows.cells * plan.cols.cells) {}

  void forward(const T* cells, T* out) override { normalize(cells, out); }
  void jvp(DualPointer<const T> cells, DualPointer<T> out) override { normalize(cells, out); }

  // Where a cell is exactly as long as ε, the mean of both sides
  void vjp(const T* cells, const T* grad_out, T* grad_cells) override {
    for (int64_t cell = 0; cell < cells_; ++cell, cells += bins_, grad_out += bins_, grad_cells += bins_) {
      const T length = std::sqrt(dot(cells, cells, bins_)), divisor = at_least(length, epsilon_);
      const T share = length > epsilon_ ? T(1) : length == epsilon_ ? T(0.5) : T(0);
      const T slope = share > 0 ? share * dot(cells, grad_out, bins_) / divisor / divisor / divisor : T(0);
      for (int64_t k = 0; k < bins_; ++k) grad_cells[k] = grad_out[k] / divisor - slope * cells[k];
    }
  }

 private:
  template <class P, class Q>
  void normalize(P cells, Q out) const {
    for (int64_t cell = 0; cell < cells_; ++cell) {
      const auto divisor = at_least(root(dot(cells, cells, bins_)), epsilon_);
      if constexpr (is_dual<std::remove_cv_t<decltype(divisor)>>) {
        scale(cells, bins_, reciprocal(divisor), out);
      } else {
        for (int64_t k = 0; k < bins_; ++k) out[k] = cells[k] / divisor;
      }
      cells = cells + bins_;
      out = out + bins_;
    }
  }

  const T epsilon_;
  const int64_t bins_, cells_;
};

}  // namespace nablahog
