// The vjp of Eq. 5-6: gradients with respect to cells, to those with respect to votes.
//
// A line is the bins of a cell, the last one in front of them and the first one behind.  For each row of pixels, the
// lines of its rows of cells are summed up with the row's weights; then each pixel reads three neighbouring numbers in
// the lines of its columns of cells.
#pragma once

#include "pooling.h"

namespace nablahog {

// Gradients with respect to a vector of pixels' votes for the bin before their own, their own and the next
template <class V>
struct VoteGradients {
  V before, here, after;
};

template <class T>
class PoolingVjp {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  PoolingVjp(const nablahog_tables& tables, Workspace& work)
      : bins_(tables.bins),
        rows_(tables.rows),
        cols_(tables.cols),
        high_(rows_.extent),
        wide_(cols_.extent),
        line_(round_up(bins_ + 3, lanes<T>)),
        lines_size_((cols_.cells + wide_) * line_),
        weights_size_(round_up(tables.width, 16) + 16),
        band_(work.zeros<T>(high_ * lines_size_)),
        lines_(work.zeros<T>(lines_size_)),
        first_(work.zeros<Int<T>>(weights_size_)) {
    for (int64_t run = 0; run < cols_.stretches; ++run) {
      const Stretch columns = stretch(cols_, run);
      for (int64_t x = columns.begin; x < columns.end; ++x) first_[x] = Int<T>(columns.cell * line_);
    }
    if constexpr (most_tables<T> > 0) make_taps(tables.width, work);
  }

  // Copies the gradients of the cells of a band, of (rows, cols, bins)
  void begin_band(int64_t band, const T* grad_cells) {
    const int64_t first = stretch(rows_, band).cell;
    for (int64_t k = 0; k < high_; ++k) {
      T* __restrict to = band_ + k * lines_size_;
      if (first + k >= rows_.cells) {
        std::memset(to, 0, lines_size_ * sizeof(T));
        continue;
      }
      const T* __restrict from = grad_cells + (first + k) * cols_.cells * bins_;
      for (int64_t col = 0; col < cols_.cells; ++col, to += line_, from += bins_) {
        for (int64_t bin = 0; bin < bins_; ++bin) to[bin + 1] = from[bin];
        to[0] = from[bins_ - 1];
        to[bins_ + 1] = from[0];
      }
    }
  }

  // Sums the lines of the band's rows of cells for row y of pixels
  void begin_row(int64_t y) {
    const T* weights = static_cast<const T*>(rows_.weights) + y * high_;
    for (int64_t k = 0; k < lines_size_; k += lanes<T>) {
      V total = load<V>(band_ + k) * weights[0];
      for (int64_t of = 1; of < high_; ++of) {
        total = multiply_add(load<V>(band_ + of * lines_size_ + k), splat<V>(weights[of]), total);
      }
      store(lines_ + k, total);
    }
  }

  // Of pixels from column x, a whole number of vectors, on, of a row with these bins; of hard votes, `here` alone
  template <bool HARD>
  [[gnu::always_inline]] VoteGradients<V> read(int64_t x, const Int<T>* bins) const {
    if constexpr (most_tables<T> >= 1) {
      if (vectors_ == 1) return look_up<HARD, 1>(x, load<I>(bins + x));
    }
    if constexpr (most_tables<T> >= 2) {
      if (vectors_ == 2) return look_up<HARD, 2>(x, load<I>(bins + x));
    }
    if constexpr (most_tables<T> >= 3) {
      if (vectors_ == 3) return look_up<HARD, 3>(x, load<I>(bins + x));
    }
    if constexpr (!HARD && lanes<T> >= 4) return read_fours(x, bins + x);
    return read_each<HARD>(x, bins + x);
  }

 private:
  [[gnu::always_inline]] V weights(int64_t k, int64_t x) const {
    return load<V>(static_cast<const T*>(cols_.cell_weights) + k * weights_size_ + x);
  }

  // One pixel after the other
  template <bool HARD>
  [[gnu::always_inline]] VoteGradients<V> read_each(int64_t x, const Int<T>* bin) const {
    const Int<T>* first = first_ + x;
    VoteGradients<V> out{};
    for (int64_t k = 0; k < wide_; ++k) {
      const T* line = lines_ + k * line_;
      T numbers[3][lanes<T>];
      NABLAHOG_UNROLL
      for (int lane = 0; lane < lanes<T>; ++lane) {
        for (int j = 0; j < 3; ++j) numbers[j][lane] = line[first[lane] + bin[lane] + j];
      }
      const V by = weights(k, x);
      out.here = multiply_add(load<V>(numbers[1]), by, out.here);
      if constexpr (!HARD) {
        out.before = multiply_add(load<V>(numbers[0]), by, out.before);
        out.after = multiply_add(load<V>(numbers[2]), by, out.after);
      }
    }
    return out;
  }

  // Four numbers from each column of cells, of which three count, for four pixels at a time
  [[gnu::always_inline]] VoteGradients<V> read_fours(int64_t x, const Int<T>* bin) const {
    using Four = Vec<T, 4>;
    constexpr int parts = lanes<T> / 4;
    const Int<T>* first = first_ + x;
    const T* by = static_cast<const T*>(cols_.cell_weights) + x;
    Four before[parts], here[parts], after[parts];
    NABLAHOG_UNROLL
    for (int part = 0; part < parts; ++part) {
      Four pixels[4];
      NABLAHOG_UNROLL
      for (int j = 0; j < 4; ++j) {
        const int lane = 4 * part + j;
        const T* from = lines_ + first[lane] + bin[lane];
        pixels[j] = load<Four>(from) * by[lane];
        for (int64_t k = 1; k < wide_; ++k) {
          pixels[j] = multiply_add(load<Four>(from + k * line_), splat<Four>(by[k * weights_size_ + lane]), pixels[j]);
        }
      }
      transpose(pixels);
      before[part] = pixels[0];
      here[part] = pixels[1];
      after[part] = pixels[2];
    }
    return {join<V>(before), join<V>(here), join<V>(after)};
  }

  // The bins of a cell are a table of a few vectors, in which lanes look up their own.  All cells that the pixels
  // of a vector vote into are asked, with the pixels' weights in these: 0 for those that vote elsewhere.
  struct VectorTaps {
    int64_t first, count;  // cells
    T* weights;            // (count, lanes)
  };

  void make_taps(int64_t width, Workspace& work) {
    vectors_ = int((bins_ + 2 + lanes<T> - 1) / lanes<T>);
    if (vectors_ > most_tables<T>) return;
    taps_ = work.zeros<VectorTaps>(round_up(width, lanes<T>) / lanes<T>);
    for (int64_t run = 0; run < cols_.stretches; ++run) {  // which cells
      const Stretch columns = stretch(cols_, run);
      for (int64_t x = columns.begin; x < columns.end; ++x) {
        VectorTaps& taps = taps_[x / lanes<T>];
        if (taps.count == 0) taps.first = columns.cell;
        const int64_t last = columns.cell + wide_;
        if (last - taps.first > taps.count) taps.count = last - taps.first;
      }
    }
    for (int64_t run = 0; run < cols_.stretches; ++run) {
      const Stretch columns = stretch(cols_, run);
      for (int64_t x = columns.begin; x < columns.end; ++x) {
        VectorTaps& taps = taps_[x / lanes<T>];
        if (!taps.weights) taps.weights = work.zeros<T>(taps.count * lanes<T>);
        T* to = taps.weights + (columns.cell - taps.first) * lanes<T> + x % lanes<T>;
        const T* from = static_cast<const T*>(cols_.cell_weights) + x;
        for (int64_t k = 0; k < wide_; ++k) to[k * lanes<T>] = from[k * weights_size_];
      }
    }
  }

  template <bool HARD, int VECTORS>
  [[gnu::always_inline]] VoteGradients<V> look_up(int64_t x, I bin) const {
    const VectorTaps& taps = taps_[x / lanes<T>];
    const T* line = lines_ + taps.first * line_;
    VoteGradients<V> out{};
    for (int64_t k = 0; k < taps.count; ++k, line += line_) {
      V table[VECTORS];
      for (int j = 0; j < VECTORS; ++j) table[j] = load<V>(line + j * lanes<T>);
      const V by = load<V>(taps.weights + k * lanes<T>);
      out.here = multiply_add(permute(table, bin + 1), by, out.here);
      if constexpr (!HARD) {
        out.before = multiply_add(permute(table, bin), by, out.before);
        out.after = multiply_add(permute(table, bin + 2), by, out.after);
      }
    }
    return out;
  }

  const int64_t bins_;
  const nablahog_axis &rows_, &cols_;
  const int64_t high_, wide_, line_, lines_size_, weights_size_;
  T *band_, *lines_;
  Int<T>* first_;  // where the line of each column's first cell begins
  VectorTaps* taps_ = nullptr;
  int vectors_ = 0;  // of a table
};

}  // namespace nablahog
