// Rectangular blocks of cells, each normalised for itself (scikit-image, OpenCV): BlockNorm in normalizers/block.py.
#pragma once

#include "normalizer.h"

namespace nablahog {

template <class T>
class BlockNorm final : public Normalizer<T> {
 public:
  using V = Vec<T>;

  BlockNorm(const nablahog_tables& tables, Workspace& work)
      : high_(int64_t(tables.constants[0])),
        wide_(int64_t(tables.constants[1])),
        down_(int64_t(tables.constants[2])),
        across_(int64_t(tables.constants[3])),
        epsilon_(T(tables.constants[4])),
        epsilon_again_(T(tables.constants[5])),
        clip_(T(tables.constants[6])),
        form_(Form(int(tables.constants[7]))),
        outside_root_(tables.constants[8]),
        squares_(form_ == L2 || form_ == L2_HYS),
        bins_(tables.bins),
        rows_(tables.out_rows),
        cols_(tables.out_cols),
        cells_(tables.rows.cells * tables.cols.cells),
        cells_across_(tables.cols.cells),
        row_(wide_ * bins_),
        size_(high_ * row_),
        line_(round_up(size_, lanes<T>)),
        x_{work.zeros<T>(line_), work.zeros<T>(line_)},
        grad_(work.zeros<T>(line_)),
        sums_{work.zeros<T>(cells_), work.zeros<T>(cells_)} {}

  void forward(const T* cells, T* out) override { normalize(cells, out, x_.value, sums_.value); }
  void jvp(DualPointer<const T> cells, DualPointer<T> out) override { normalize(cells, out, x_, sums_); }

  void vjp(const T* cells, const T* grad_out, T* grad_cells) override {
    sum_cells(cells, sums_.value);
    std::memset(grad_cells, 0, cells_ * bins_ * sizeof(T));
    each_block([&](int64_t row, int64_t col, int64_t block) {
      const int64_t at = (row * cells_across_ + col) * bins_;
      gather(cells + at, cells_across_ * bins_, x_.value);
      gather(grad_out + block * size_, row_, grad_);
      block_vjp(sum_block(sums_.value, row, col));
      for (int64_t k = 0; k < high_; ++k) {
        T* to = grad_cells + at + k * cells_across_ * bins_;
        for (int64_t j = 0; j < row_; j += lanes<T>) {
          store_first(to + j, load_first(to + j, row_ - j) + load<V>(grad_ + k * row_ + j), row_ - j);
        }
      }
    });
  }

 private:
  enum Form { L1, L1_SQRT, L2, L2_HYS };

  template <class F>
  void each_block(F body) const {
    for (int64_t row = 0; row < rows_; ++row) {
      for (int64_t col = 0; col < cols_; ++col) {
        body(row * down_, col * across_, row * cols_ + col);
      }
    }
  }

  template <class P, class Q, class L>
  void normalize(P cells, Q out, L x, L sums) const {
    sum_cells(cells, sums);
    each_block([&](int64_t row, int64_t col, int64_t block) {
      gather(cells + (row * cells_across_ + col) * bins_, cells_across_ * bins_, x);
      scale(x, size_, normalize_block(x, sum_block(sums, row, col)), out + block * size_);
    });
  }

  // Normalises the line x for the first time, up to a factor, which is returned: the result is the factor times x.
  template <class L, class S>
  [[gnu::always_inline]] S normalize_block(L x, S total) const {
    const S factor = first_factor(total);
    const auto by = spread(factor);
    if (form_ == L2_HYS) {
      typename Pointee<L>::Vector squares{};
      for (int64_t k = 0; k < line_; k += lanes<T>) {
        const auto entries = clipped(load_vector(x + k) * by, clip_);
        squares = multiply_add(entries, entries, squares);
        store_vector(x + k, entries);
      }
      return inverse_length(sum(squares), epsilon_again_);
    }
    if (form_ == L1_SQRT) {
      for (int64_t k = 0; k < line_; k += lanes<T>) store_vector(x + k, root(load_vector(x + k) * by));
      return constant<S>(T(1));
    }
    return factor;
  }

  // Turns `grad_`, the gradient with respect to the result, into that with respect to the histograms.
  void block_vjp(T total) {
    const T factor = first_factor(total);
    T* x = x_.value;
    V products{};
    if (form_ == L2_HYS) {
      products = clip_vjp(x, factor);
    } else {
      for (int64_t k = 0; k < line_; k += lanes<T>) {
        V grad = load<V>(grad_ + k);
        if (form_ == L1_SQRT) {
          const V root = sqrt(load<V>(x + k) * factor);
          grad = root > T(0) ? grad * T(0.5) / root : V{};
          store(grad_ + k, grad);
        }
        products = multiply_add(load<V>(x + k), grad, products);
      }
    }
    const T product = sum(products);
    const T by_x = squares_ ? slope(total, factor, product) : 0, less = squares_ ? 0 : factor * factor * product;
    for (int64_t k = 0; k < line_; k += lanes<T>) {
      store(grad_ + k, load<V>(grad_ + k) * factor - (load<V>(x + k) * by_x + less));
    }
  }

  // L2-Hys: to the gradients of the first normalisation; returns the products of these and x.
  [[gnu::always_inline]] V clip_vjp(const T* x, T factor) {
    V squares{}, products{};
    for (int64_t k = 0; k < line_; k += lanes<T>) {
      const V entries = clipped(load<V>(x + k) * factor, clip_);
      squares = multiply_add(entries, entries, squares);
      products = multiply_add(entries, load<V>(grad_ + k), products);
    }
    const T energy = sum(squares), again = inverse_length(energy, epsilon_again_);
    const T by_entries = slope(energy, again, sum(products));
    products = V{};
    for (int64_t k = 0; k < line_; k += lanes<T>) {
      const V of_x = load<V>(x + k), entries = of_x * factor;
      const V grad = load<V>(grad_ + k) * again - clipped(entries, clip_) * by_entries;
      const V passed = through_clip(entries, clip_, grad);
      products = multiply_add(of_x, passed, products);
      store(grad_ + k, passed);
    }
    return products;
  }

  template <class S>
  S first_factor(S total) const {
    return squares_ ? inverse_length(total, epsilon_) : reciprocal(total + constant<S>(epsilon_));
  }
  template <class S>
  S inverse_length(S energy, T epsilon) const {
    return reciprocal(outside_root_ ? root(energy) + constant<S>(epsilon)
                                    : root(energy + constant<S>(epsilon * epsilon)));
  }
  // The coefficient s of the vjp x̄ = f · ȳ - s · x, with product = ⟨x, ȳ⟩
  T slope(T energy, T factor, T product) const {
    if (!outside_root_) return factor * factor * factor * product;
    return energy > 0 ? factor * factor * product / std::sqrt(energy) : T(0);
  }

  // The rows of a block, `stride` apart, one after the other, then zeros
  void gather(const T* from, int64_t stride, T* to) const {
    store(to + line_ - lanes<T>, V{});
    for (int64_t k = 0; k < high_; ++k, from += stride, to += row_) {
      for (int64_t j = 0; j < row_; j += lanes<T>) store(to + j, load_first(from + j, row_ - j));
    }
  }
  void gather(DualPointer<const T> from, int64_t stride, DualPointer<T> to) const {
    gather(from.value, stride, to.value);
    gather(from.tangent, stride, to.tangent);
  }

  // For each cell, the sum of its bins, or of their squares
  template <class P, class L>
  void sum_cells(P cells, L sums) const {
    for (int64_t cell = 0; cell < cells_; ++cell, cells = cells + bins_) {
      if (squares_) {
        put(sums, cell, dot(cells, cells, bins_));
      } else {
        auto total = get(cells, 0);
        for (int64_t k = 1; k < bins_; ++k) total += get(cells, k);
        put(sums, cell, total);
      }
    }
  }
  template <class L>
  auto sum_block(L sums, int64_t row, int64_t col) const {
    typename Pointee<L>::Scalar total{};
    for (int64_t y = row; y < row + high_; ++y) {
      for (int64_t x = col; x < col + wide_; ++x) total += get(sums, y * cells_across_ + x);
    }
    return total;
  }

  const int64_t high_, wide_, down_, across_;  // cells of a block, and from one to the next
  const T epsilon_, epsilon_again_, clip_;
  const Form form_;
  const bool outside_root_, squares_;  // whether ε is added to the root; whether the norm sums squares
  const int64_t bins_, rows_, cols_, cells_, cells_across_, row_, size_, line_;
  const DualPointer<T> x_;  // line: of a block
  T* grad_;                 // line
  const DualPointer<T> sums_;
};

}  // namespace nablahog
