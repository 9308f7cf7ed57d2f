// Normalisers that make of each cell's histogram a vector of as many numbers: normalizers/per_cell.py.
#pragma once

#include "normalizer.h"

namespace nablahog {

// Eq. 7 as printed, v / √(‖v‖ + ε), or robust, v / √(‖v‖² + ε²), with v all cells of an image
template <class T>
class GlobalNorm final : public Normalizer<T> {
 public:
  GlobalNorm(const nablahog_tables& tables, Workspace&)
      : epsilon_(tables.constants[0]),
        robust_(tables.constants[1]),
        size_(tables.rows.cells * tables.cols.cells * tables.bins) {}

  void forward(const T* cells, T* out) override { normalize(cells, out); }
  void jvp(DualPointer<const T> cells, DualPointer<T> out) override { normalize(cells, out); }

  // x̄ = f · ȳ + f' · ⟨x, ȳ⟩ · x, with f the factor
  void vjp(const T* __restrict cells, const T* __restrict grad_out, T* __restrict grad_cells) override {
    const double energy = long_energy(cells, size_), product = long_dot(cells, grad_out, size_);
    const double length = std::sqrt(energy), f = factor(energy), cubed = f * f * f * product;
    const double slope = robust_ ? -cubed : length > 0 ? -0.5 * cubed / length : 0.0;
    const T by_grad = T(f), by_cells = T(slope);
    for (int64_t k = 0; k < size_; ++k) grad_cells[k] = grad_out[k] * by_grad + cells[k] * by_cells;
  }

 private:
  template <class N>
  N factor(N energy) const {
    return reciprocal(root(robust_ ? energy + constant<N>(epsilon_ * epsilon_) : root(energy) + constant<N>(epsilon_)));
  }

  template <class P, class Q>
  void normalize(P cells, Q out) const {
    const auto f = factor(long_energy(cells, size_));
    if constexpr (is_dual<std::remove_cv_t<decltype(f)>>) {
      scale(cells, size_, Dual<T>{T(f.value), T(f.tangent)}, out);
    } else {
      scale(cells, size_, T(f), out);
    }
  }

  const double epsilon_;
  const bool robust_;
  const int64_t size_;
};

// Each cell's histogram for itself: v / max(‖v‖, ε)
template <class T>
class CellNorm final : public Normalizer<T> {
 public:
  CellNorm(const nablahog_tables& tables, Workspace&)
      : epsilon_(T(tables.constants[0])), bins_(tables.bins), cells_(tables.rows.cells * tables.cols.cells) {}

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
