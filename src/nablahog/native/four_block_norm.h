// Each cell by the four blocks of 2x2 cells that it lies in (UoCTTI): FourBlockNorm in normalizers/four_block.py.
//
// Block (y, x) lies around the corner up-left of cell (y, x): there are (rows + 1, cols + 1).
#pragma once

#include "normalizer.h"

namespace nablahog {

template <class T>
class FourBlockNorm final : public Normalizer<T> {
 public:
  using V = Vec<T>;

  FourBlockNorm(const nablahog_tables& tables, Workspace& work)
      : constants_(tables.constants),
        epsilon_(T(constants_.epsilon)),
        clip_(T(constants_.clip)),
        texture_(T(constants_.texture)),
        bins_(tables.bins),
        axes_(constants_.is_signed ? bins_ / 2 : bins_),
        rows_(tables.rows.cells),
        cols_(tables.cols.cells),
        channels_(tables.out_channels),
        energies_{work.zeros<T>(rows_ * cols_), work.zeros<T>(rows_ * cols_)},
        factors_{work.zeros<T>((rows_ + 1) * (cols_ + 1)), work.zeros<T>((rows_ + 1) * (cols_ + 1))},
        grad_factors_(work.zeros<T>((rows_ + 1) * (cols_ + 1))),
        cell_{work.zeros<T>(channels_ + lanes<T>), work.zeros<T>(channels_ + lanes<T>)},
        grad_(work.zeros<T>(bins_ + lanes<T>)) {}

  void forward(const T* cells, T* out) override { normalize(cells, out, energies_.value, factors_.value, cell_.value); }
  void jvp(DualPointer<const T> cells, DualPointer<T> out) override {
    normalize(cells, out, energies_, factors_, cell_);
  }

  void vjp(const T* cells, const T* grad_out, T* grad_cells) override {
    find_factors(cells, energies_.value, factors_.value);
    std::memset(grad_factors_, 0, (rows_ + 1) * (cols_ + 1) * sizeof(T));
    std::memset(grad_cells, 0, rows_ * cols_ * bins_ * sizeof(T));
    each_described_cell([&](int64_t cell, int64_t corner, int64_t index) {
      const T *histogram = cells + cell * bins_, *grad = grad_out + index * channels_;
      T* to = grad_cells + cell * bins_;
      Blocks<T> four = blocks_at(factors_.value, corner);
      V by_factor[4] = {};
      if (constants_.directed_at >= 0 || constants_.directed_texture)
        directed_vjp(histogram, grad, four, by_factor, to);
      undirected_vjp(histogram, grad, four, by_factor, to);
      grad_factors_[corner] += sum(by_factor[0]);
      grad_factors_[corner + 1] += sum(by_factor[1]);
      grad_factors_[corner + cols_ + 1] += sum(by_factor[2]);
      grad_factors_[corner + cols_ + 2] += sum(by_factor[3]);
    });
    factors_vjp();
    for (int64_t cell = 0; cell < rows_ * cols_; ++cell) {
      const T* histogram = cells + cell * bins_;
      T* to = grad_cells + cell * bins_;
      const T twice = 2 * energies_.value[cell];
      for (int64_t k = 0; k < axes_; k += lanes<T>) store(grad_ + k, undirected(histogram, k) * twice);
      add_undirected(to);
    }
  }

 private:
  // Channels are parts; one that is left out begins at -1.
  struct Constants {
    explicit Constants(const double* from)
        : epsilon(from[0]),
          clip(from[1]),
          texture(from[2]),
          texture_order{int64_t(from[3]), int64_t(from[4]), int64_t(from[5]), int64_t(from[6])},
          directed_at(int64_t(from[7])),
          undirected_at(int64_t(from[8])),
          texture_at(int64_t(from[9])),
          blocks_at(int64_t(from[10])),
          zero_at(int64_t(from[11])),
          dropped(int64_t(from[12])),
          floor(from[13]),
          missing(from[14]),
          is_signed(from[15]),
          directed_texture(from[16]) {}

    double epsilon, clip, texture;  // the last one is the factor of texture channels
    int64_t texture_order[4];       // the texture channel of the block up-left, up-right, down-left, down-right
    int64_t directed_at, undirected_at, texture_at, blocks_at, zero_at;
    int64_t dropped;  // outermost rings of cells that are not described
    bool floor;       // √energy is at least ε; else ε is added to the energy
    bool missing;     // blocks that reach beyond the grid add nothing
    bool is_signed;
    bool directed_texture;  // texture sums directed histograms
  };

  // What the blocks up-left, up-right, down-left, down-right of a cell have
  template <class N>
  struct Blocks {
    N of[4];
  };
  template <class L>
  auto blocks_at(L of_blocks, int64_t corner) const {
    using N = typename Pointee<L>::Scalar;
    return Blocks<N>{{get(of_blocks, corner), get(of_blocks, corner + 1), get(of_blocks, corner + cols_ + 1),
                      get(of_blocks, corner + cols_ + 2)}};
  }

  // Calls body(cell, its corner up-left, its index in the descriptor)
  template <class F>
  void each_described_cell(F body) const {
    const int64_t ring = constants_.dropped;
    int64_t index = 0;
    for (int64_t y = ring; y < rows_ - ring; ++y) {
      for (int64_t x = ring; x < cols_ - ring; ++x) body(y * cols_ + x, y * (cols_ + 1) + x, index++);
    }
  }

  // The contrast-insensitive histogram from bin k on
  template <class P>
  [[gnu::always_inline]] auto undirected(P histogram, int64_t k) const {
    const auto entries = load_first(histogram + k, axes_ - k);
    return constants_.is_signed ? entries + load_first(histogram + axes_ + k, axes_ - k) : entries;
  }

  // ---- What each block multiplies its cells by ----------------------------------------------------------------------

  // The cells of a block; beyond the edge they are repeated.
  Blocks<int64_t> cells_of_block(int64_t y, int64_t x) const {
    const int64_t up = y > 0 ? y - 1 : 0, down = y < rows_ ? y : rows_ - 1;
    const int64_t left = x > 0 ? x - 1 : 0, right = x < cols_ ? x : cols_ - 1;
    return {{up * cols_ + left, up * cols_ + right, down * cols_ + left, down * cols_ + right}};
  }

  template <class P, class L>
  void find_factors(P cells, L energies, L factors) const {
    using N = typename Pointee<L>::Scalar;
    for (int64_t cell = 0; cell < rows_ * cols_; ++cell) {
      typename Pointee<L>::Vector squares{};
      for (int64_t k = 0; k < axes_; k += lanes<T>) {
        const auto entries = undirected(cells + cell * bins_, k);
        squares = multiply_add(entries, entries, squares);
      }
      put(energies, cell, sum(squares));
    }
    for (int64_t y = 0; y <= rows_; ++y) {
      for (int64_t x = 0; x <= cols_; ++x) {
        const Blocks<int64_t> at = cells_of_block(y, x);
        const N energy =
            (get(energies, at.of[0]) + get(energies, at.of[1])) + (get(energies, at.of[2]) + get(energies, at.of[3]));
        const bool outermost = y == 0 || x == 0 || y == rows_ || x == cols_;
        const N factor = constants_.floor ? reciprocal(at_least(root(energy), epsilon_))
                                          : reciprocal(root(energy + constant<N>(epsilon_)));
        put(factors, y * (cols_ + 1) + x, constants_.missing && outermost ? N{} : factor);
      }
    }
  }

  // From gradients of the factors to those of the energies of cells, which they overwrite
  void factors_vjp() {
    std::memset(energies_.value, 0, rows_ * cols_ * sizeof(T));
    for (int64_t y = 0; y <= rows_; ++y) {
      for (int64_t x = 0; x <= cols_; ++x) {
        const int64_t corner = y * (cols_ + 1) + x;
        const T factor = factors_.value[corner];
        T grad = T(-0.5) * grad_factors_[corner] * factor * factor * factor;
        if (constants_.floor && factor >= 1 / epsilon_) grad = 0;
        for (int64_t cell : cells_of_block(y, x).of) energies_.value[cell] += grad;
      }
    }
  }

  // ---- Forward ------------------------------------------------------------------------------------------------------

  template <class P, class Q, class L>
  void normalize(P cells, Q out, L energies, L factors, L channels) const {
    find_factors(cells, energies, factors);
    each_described_cell([&](int64_t cell, int64_t corner, int64_t index) {
      describe(cells + cell * bins_, blocks_at(factors, corner), channels);
      for (int64_t k = 0; k < channels_; ++k) put(out, index * channels_ + k, get(channels, k));
    });
  }

  // The channels of a cell, part after part: what is written behind one belongs to the next.
  template <class P, class N, class L>
  [[gnu::always_inline]] void describe(P histogram, const Blocks<N>& factors, L out) const {
    using W = typename Pointee<L>::Vector;
    const W by[4] = {spread(factors.of[0]), spread(factors.of[1]), spread(factors.of[2]), spread(factors.of[3])};
    const auto directed = [&](int64_t k) { return load_first(histogram + k, bins_ - k); };
    const auto folded = [&](int64_t k) { return undirected(histogram, k); };
    Blocks<N> totals{};
    if (constants_.directed_at >= 0 || constants_.directed_texture) {
      sum_blocks(directed, bins_, by, constants_.directed_at, constants_.directed_texture, out, totals);
    }
    sum_blocks(folded, axes_, by, constants_.undirected_at, !constants_.directed_texture, out, totals);
    if (constants_.texture_at >= 0) {
      for (int block = 0; block < 4; ++block) {
        put(out, constants_.texture_at + constants_.texture_order[block], times(totals.of[block], texture_));
      }
    }
    for (int block = 0; block < 4 && constants_.blocks_at >= 0; ++block) {
      for (int64_t k = 0; k < axes_; k += lanes<T>) {
        store_vector(out + (constants_.blocks_at + block * axes_ + k), clipped(folded(k) * by[block], clip_));
      }
    }
    if (constants_.zero_at >= 0) put(out, constants_.zero_at, N{});
  }

  // To channels from `at` on (unless that is -1), half the sums over the blocks of the clipped entries; to `totals`, if
  // wanted, each block's sum over the bins
  template <class F, class W, class L, class N>
  [[gnu::always_inline]] void sum_blocks(F entries, int64_t count, const W (&by)[4], int64_t at, bool wanted, L out,
                                         Blocks<N>& totals) const {
    W sums[4] = {};
    for (int64_t k = 0; k < count; k += lanes<T>) {
      const W x = entries(k);
      W parts[4];
      NABLAHOG_UNROLL
      for (int block = 0; block < 4; ++block) {
        parts[block] = clipped(x * by[block], clip_);
        sums[block] += parts[block];
      }
      if (at >= 0) store_vector(out + (at + k), times((parts[0] + parts[1]) + (parts[2] + parts[3]), T(0.5)));
    }
    for (int block = 0; block < 4 && wanted; ++block) totals.of[block] = sum(sums[block]);
  }

  // ---- Vjp ----------------------------------------------------------------------------------------------------------

  // Gradients with respect to each block's total
  Blocks<T> grad_totals(const T* grad, bool directed) const {
    Blocks<T> of_totals{};
    if (constants_.texture_at < 0 || constants_.directed_texture != directed) return of_totals;
    for (int block = 0; block < 4; ++block) {
      of_totals.of[block] = texture_ * grad[constants_.texture_at + constants_.texture_order[block]];
    }
    return of_totals;
  }

  // Of the channels made from the histogram itself, to those of the histogram and, added, of the factors
  void directed_vjp(const T* histogram, const T* grad, const Blocks<T>& factors, V (&by_factor)[4], T* to) {
    const Blocks<T> of_totals = grad_totals(grad, true);
    for (int64_t k = 0; k < bins_; k += lanes<T>) {
      V of_sum{};
      if (constants_.directed_at >= 0) of_sum = load_first(grad + constants_.directed_at + k, bins_ - k) * T(0.5);
      const V of_blocks[4] = {of_sum + of_totals.of[0], of_sum + of_totals.of[1], of_sum + of_totals.of[2],
                              of_sum + of_totals.of[3]};
      store(grad_ + k, entries_vjp(load_first(histogram + k, bins_ - k), of_blocks, factors, by_factor));
    }
    for (int64_t k = 0; k < bins_; ++k) to[k] = grad_[k];
  }

  // Of those made from the contrast-insensitive histogram, added
  void undirected_vjp(const T* histogram, const T* grad, const Blocks<T>& factors, V (&by_factor)[4], T* to) {
    const Blocks<T> of_totals = grad_totals(grad, false);
    const int64_t sums_at = constants_.undirected_at, blocks_at = constants_.blocks_at;
    for (int64_t k = 0; k < axes_; k += lanes<T>) {
      V of_sum{}, of_blocks[4];
      if (sums_at >= 0) of_sum = load_first(grad + sums_at + k, axes_ - k) * T(0.5);
      NABLAHOG_UNROLL
      for (int block = 0; block < 4; ++block) {
        of_blocks[block] = of_sum + of_totals.of[block];
        if (blocks_at >= 0) of_blocks[block] += load_first(grad + blocks_at + block * axes_ + k, axes_ - k);
      }
      store(grad_ + k, entries_vjp(undirected(histogram, k), of_blocks, factors, by_factor));
    }
    add_undirected(to);
  }

  // From gradients of the clipped entries in each block
  [[gnu::always_inline]] V entries_vjp(V x, const V (&of_blocks)[4], const Blocks<T>& factors,
                                       V (&by_factor)[4]) const {
    V of_x{};
    NABLAHOG_UNROLL
    for (int block = 0; block < 4; ++block) {
      const V factor = splat<V>(factors.of[block]), passed = through_clip(x * factor, clip_, of_blocks[block]);
      of_x = multiply_add(passed, factor, of_x);
      by_factor[block] = multiply_add(passed, x, by_factor[block]);
    }
    return of_x;
  }

  // Adds `grad_`, of a contrast-insensitive histogram, to that of the histogram
  void add_undirected(T* __restrict to) const {
    for (int64_t k = 0; k < axes_; ++k) to[k] += grad_[k];
    for (int64_t k = 0; k < axes_ && constants_.is_signed; ++k) to[axes_ + k] += grad_[k];
  }

  const Constants constants_;
  const T epsilon_, clip_, texture_;
  const int64_t bins_, axes_, rows_, cols_, channels_;
  const DualPointer<T> energies_, factors_;
  T* grad_factors_;
  const DualPointer<T> cell_;  // channels of a cell
  T* grad_;                    // of a histogram
};

}  // namespace nablahog
