// Eq. 5-6: votes of pixels to histograms of cells.
//
// A *band* is rows of pixels that vote into the same rows of cells, a *run* columns that vote into the same columns of
// cells: with bilinear votes into two, with boxes into one.  The votes of a band are summed over its rows, bin by bin,
// then over the columns of each run.  Each bin masks the votes of a vector of pixels: lanes never write to the same
// sum, and sums stay in registers until the band ends.
#pragma once

#include "tables.h"
#include "vec.h"
#include "workspace.h"

namespace nablahog {

constexpr int bins_at_once = 9;           // whose sums are in registers
constexpr int64_t columns_at_once = 128;  // of pixels: their sums stay in the first-level cache

struct Stretch {
  int64_t begin, end, cell;  // pixels begin … end - 1 vote into cells from this one on
};
inline Stretch stretch(const nablahog_axis& axis, int64_t k) {
  return {axis.stretch[3 * k], axis.stretch[3 * k + 1], axis.stretch[3 * k + 2]};
}

// Votes of the rows of a band, `stride` apart: for a pixel's own bin, the next, and (tangents) the one before
template <class T>
struct Planes {
  T *here, *after, *before;
  Int<T>* bin;
  int64_t stride;
};

template <class T>
class Pooling {
 public:
  using V = Vec<T>;

  Pooling(const nablahog_tables& tables, Workspace& work)
      : bins_(tables.bins),
        rows_(tables.rows),
        cols_(tables.cols),
        high_(rows_.extent),
        wide_(cols_.extent),
        line_(line_size(tables)),
        sums_size_(round_up(columns_at_once < cols_.longest ? cols_.longest : columns_at_once, lanes<T>) + lanes<T>),
        sums_(work.zeros<T>(line_ * sums_size_)),
        band_(work.zeros<T>(band_size(tables))) {}

  // Numbers of the cells of a band: columns, each a line of the bins of its rows of cells
  static int64_t band_size(const nablahog_tables& tables) {
    return (tables.cols.cells + tables.cols.extent) * line_size(tables);
  }

  // Forgets sums of an image with NaN, which a weight of zero would not remove
  void clear() { std::memset(sums_, 0, line_ * sums_size_ * sizeof(T)); }

  // Eq. 5-6: the cells of a band from its votes, planes 1 … PLANES of them
  template <int PLANES>
  const T* pool(int64_t band, const Planes<T>& votes) {
    std::memset(band_, 0, (cols_.cells + wide_) * line_ * sizeof(T));
    const Stretch of_band = stretch(rows_, band);
    for (int64_t run = 0, next = 0; run < cols_.stretches; run = next) {
      const int64_t left = stretch(cols_, run).begin;
      for (next = run + 1; next < cols_.stretches && stretch(cols_, next).end - left <= columns_at_once;) ++next;
      const int64_t right = stretch(cols_, next - 1).end;
      for (int64_t k = 0; k < high_; k += 2) {
        if (high_ == 1) {
          sum_rows<PLANES, 1>(votes, of_band, k, left, right);
        } else {
          sum_rows<PLANES, 2>(votes, of_band, k, left, right);
        }
      }
      for (int64_t k = run; k < next; ++k) {
        if (wide_ == 1) {
          pool_run<1>(k, 0, left);
        } else {
          for (int64_t pair = 0; pair < wide_; pair += 2) pool_run<2>(k, pair, left);
        }
      }
    }
    return band_;
  }

  // Adds the cells of a band to those of the image, (rows, cols, bins)
  void add_band(int64_t band, const T* band_cells, T* cells) const {
    const int64_t first = stretch(rows_, band).cell;
    for (int64_t k = 0; k < high_ && first + k < rows_.cells; ++k) {
      T* __restrict to = cells + (first + k) * cols_.cells * bins_;
      const T* __restrict from = band_cells + k * bins_;
      for (int64_t col = 0; col < cols_.cells; ++col, to += bins_, from += line_) {
        for (int64_t bin = 0; bin < bins_; ++bin) to[bin] += from[bin];
      }
    }
  }

 private:
  static constexpr int square = lanes<T> > 8 ? 8 : lanes<T>;  // lines and columns that are transposed at a time
  using Square = Vec<T, square>;

  static int64_t line_size(const nablahog_tables& tables) { return round_up(tables.rows.extent * tables.bins, 8); }

  // Sums columns of votes over the rows of a band, weighted for HIGH rows of cells from the k-th on
  template <int PLANES, int HIGH>
  void sum_rows(const Planes<T>& votes, Stretch band, int64_t k, int64_t left, int64_t right) {
    using I = Vec<Int<T>>;
    const T* row_weights = static_cast<const T*>(rows_.weights) + band.begin * high_ + k;
    for (int64_t group = 0; group < bins_; group += bins_at_once) {
      for (int64_t x = left; x < right; x += lanes<T>) {
        V totals[bins_at_once][HIGH] = {};
        for (int64_t row = 0; row < band.end - band.begin; ++row) {
          const int64_t at = row * votes.stride + x;
          const T* weights = row_weights + row * high_;
          const I bin = load<I>(votes.bin + at) - Int<T>(group);
          const V here = load<V>(votes.here + at);
          V after{}, before{};
          if constexpr (PLANES > 1) after = load<V>(votes.after + at);
          if constexpr (PLANES > 2) before = load<V>(votes.before + at);
          const I last = splat<I>(Int<T>(bins_ - 1 - group)), first = splat<I>(Int<T>(-group));
          const I bin_before = bin == first ? last : bin - Int<T>(1);
          auto previous = group ? bin == Int<T>(-1) : bin == last;
          NABLAHOG_UNROLL
          for (int j = 0; j < bins_at_once; ++j) {
            const auto own = bin == Int<T>(j);
            V vote = own ? here : V{};
            if constexpr (PLANES > 1) vote = previous ? after : vote;
            if constexpr (PLANES > 2) vote += bin_before == Int<T>(j) ? before : V{};
            NABLAHOG_UNROLL
            for (int of = 0; of < HIGH; ++of) {
              totals[j][of] = multiply_add(vote, splat<V>(weights[of]), totals[j][of]);
            }
            previous = own;
          }
        }
        for (int j = 0; j < bins_at_once && group + j < bins_; ++j) {
          for (int of = 0; of < HIGH; ++of) {
            store(sums_ + ((k + of) * bins_ + group + j) * sums_size_ + x - left, totals[j][of]);
          }
        }
      }
    }
  }

  // Adds the columns of a run to WIDE columns of cells from the pair-th on
  template <int WIDE>
  void pool_run(int64_t run, int64_t pair, int64_t left) const {
    const Stretch of_run = stretch(cols_, run);
    const T* weights = static_cast<const T*>(cols_.run_weights) + (run * wide_ + pair) * cols_.run;
    T* to = band_ + (of_run.cell + pair) * line_;
    for (int64_t x = of_run.begin; x < of_run.end; x += square, weights += square) {
      for (int64_t k = 0; k < line_; k += square) {
        Square columns[square];
        NABLAHOG_UNROLL
        for (int j = 0; j < square; ++j) columns[j] = load<Square>(sums_ + (k + j) * sums_size_ + x - left);
        transpose(columns);
        NABLAHOG_UNROLL
        for (int cell = 0; cell < WIDE; ++cell) {
          Square total = load<Square>(to + cell * line_ + k);
          NABLAHOG_UNROLL
          for (int j = 0; j < square; ++j) {
            total = multiply_add(columns[j], splat<Square>(weights[cell * cols_.run + j]), total);
          }
          store(to + cell * line_ + k, total);
        }
      }
    }
  }

  const int64_t bins_;
  const nablahog_axis &rows_, &cols_;
  const int64_t high_, wide_, line_, sums_size_;
  T *sums_, *band_;
};

}  // namespace nablahog
