// Normalised blocks of cv2.HOGDescriptor.  The votes of a row of pixels are added to histograms of the columns of
// pixels, one for each row of cells that the row is in.  When a row of blocks is complete, these are pooled to its
// cells.
#pragma once

#include <limits>

#include "opencv_votes.h"

namespace nablahog::opencv {

// Windows and blocks of a dialect; sizes in pixels
struct Scheme {
  int64_t bins;
  int64_t window_width, window_height;
  int64_t block_width, block_height;
  int64_t across, down;          // from block to block
  int64_t cell_cols, cell_rows;  // of a block
  const float *by_col, *by_row;  // weights of a block's pixels: (cell_cols, block_width), (cell_rows, block_height)
  float epsilon, epsilon_again, clip;

  int64_t numbers() const { return cell_cols * cell_rows * bins; }  // of a block
  int64_t block_cols(int64_t width) const { return (width - block_width) / across + 1; }
  int64_t block_rows(int64_t height) const { return (height - block_height) / down + 1; }
};

class BlockRows {
 public:
  BlockRows(const Scheme& scheme, const Region& region, Workspace& memory)
      : scheme_(scheme),
        width_(region.width),
        rows_(scheme.block_rows(region.height)),
        ring_((scheme.block_height + scheme.down - 1) / scheme.down),
        lines_(round_up(ring_ * scheme.cell_rows, size<Four>)),
        column_((scheme.bins + 1) * lines_) {
    histograms_ = memory.zeros<float>(width_ * column_ + step);
    row_weights_ = memory.zeros<float>(lines_);
    cells_ = memory.zeros<float>(scheme.cell_cols * round_up(column_, step));
    block_ = memory.zeros<float>(scheme.numbers());
  }

  // Adds row y of pixels
  void add(const RowVotes& votes, int64_t y) {
    const int64_t height = scheme_.block_height, down = scheme_.down, cell_rows = scheme_.cell_rows;
    const int64_t begin = y < height ? 0 : (y - height) / down + 1, end = std::min(y / down + 1, rows_);
    std::fill(row_weights_, row_weights_ + lines_, 0.0f);
    for (int64_t k = begin; k < end; ++k) {
      for (int64_t row = 0; row < cell_rows; ++row)
        row_weights_[k % ring_ * cell_rows + row] = scheme_.by_row[row * height + y - k * down];
    }
    scatter(votes);
  }

  // The row of blocks whose last row of pixels is y; -1 if there is none
  int64_t completed(int64_t y) const {
    const int64_t from = y + 1 - scheme_.block_height;
    return from >= 0 && from % scheme_.down == 0 && from / scheme_.down < rows_ ? from / scheme_.down : -1;
  }

  // The normalised block of row k and a column, to out (cell_cols, cell_rows, bins)
  void block(int64_t k, int64_t col, float* out) {
    pool(col);
    const int64_t bins = scheme_.bins;
    float* to = block_;
    for (int64_t cell_col = 0; cell_col < scheme_.cell_cols; ++cell_col) {
      for (int64_t row = 0; row < scheme_.cell_rows; ++row, to += bins) {
        const float* cell = cells_ + cell_col * round_up(column_, step) + k % ring_ * scheme_.cell_rows + row;
        for (int64_t bin = 0; bin < bins; ++bin) to[bin] = cell[bin * lines_];
        to[0] += cell[bins * lines_];
      }
    }
    normalize(out);
  }

  // Makes the histograms of row k of blocks zero, for another one
  void clear(int64_t k) {
    const int32_t begin = int32_t(k % ring_ * scheme_.cell_rows), end = begin + int32_t(scheme_.cell_rows);
    for (int64_t line = 0; line < lines_; line += size<Four>) {
      const Mask<Four> index = iota<Mask<Four>>() + int32_t(line);
      const auto kept = (index < begin) | (index >= end);
      for (float* at = histograms_ + line; at < histograms_ + width_ * column_; at += lines_)
        store<Four>(at, kept ? load<Four>(at) : Four{});
    }
  }

 private:
  using V = Vec<float>;
  using Four = Vec<float, 4>;
  static constexpr int at_once = 3, step = at_once * lanes<float>;

  // Adds the votes, weighed by row_weights_
  void scatter(const RowVotes& votes) {
    const int64_t lines = lines_, column = column_;
    const float *near = votes.near, *far = votes.far, *weights = row_weights_;
    const int32_t* bin = votes.bin;
    float* begin = histograms_;
    for (int64_t x = 0; x < width_; ++x, begin += column) {
      float *to = begin + bin[x] * lines, *next = to + lines;
      const Four of_near = splat<Four>(near[x]), of_far = splat<Four>(far[x]);
      for (int64_t line = 0; line < lines; line += size<Four>) {
        const Four weight = load<Four>(weights + line);
        store<Four>(to + line, multiply_add(of_near, weight, load<Four>(to + line)));
        store<Four>(next + line, multiply_add(of_far, weight, load<Four>(next + line)));
      }
    }
  }

  // Sums over the columns of pixels of a column of blocks, for each column of cells
  void pool(int64_t col) {
    for (int64_t cell_col = 0; cell_col < scheme_.cell_cols; ++cell_col) {
      const float* weights = scheme_.by_col + cell_col * scheme_.block_width;
      int64_t begin = 0, end = scheme_.block_width;
      while (begin < end && weights[begin] == 0) ++begin;
      while (begin < end && weights[end - 1] == 0) --end;
      const float* from = histograms_ + col * scheme_.across * column_;
      float* to = cells_ + cell_col * round_up(column_, step);
      for (int64_t k = 0; k < column_; k += step) {
        V total[at_once] = {};
        for (int64_t x = begin; x < end; ++x) {
          const V weight = splat<V>(weights[x]);
          NABLAHOG_UNROLL
          for (int j = 0; j < at_once; ++j)
            total[j] = multiply_add(load<V>(from + x * column_ + k + j * lanes<float>), weight, total[j]);
        }
        NABLAHOG_UNROLL
        for (int j = 0; j < at_once; ++j) store<V>(to + k + j * lanes<float>, total[j]);
      }
    }
  }

  // Σ min(factor · v, clip)² of the block's numbers v, which are replaced by what is squared
  float energy(float factor, float clip) {
    const int64_t numbers = scheme_.numbers();
    V total{};
    for (int64_t k = 0; k < numbers; k += lanes<float>) {
      const V value = minimum(load<V>(block_ + k) * factor, splat<V>(clip));
      store<V>(block_ + k, value);
      total = multiply_add(value, value, total);
    }
    return sum(total);
  }

  // L2-Hys
  void normalize(float* __restrict out) {
    const int64_t numbers = scheme_.numbers();
    const float length = std::sqrt(energy(1, std::numeric_limits<float>::infinity()));
    const float clipped = std::sqrt(energy(1 / (length + scheme_.epsilon), scheme_.clip));
    const float factor = 1 / (clipped + scheme_.epsilon_again);
    for (int64_t k = 0; k < numbers; ++k) out[k] = factor * block_[k];
  }

  const Scheme& scheme_;
  const int64_t width_, rows_;
  const int64_t ring_;    // rows of blocks that a row of pixels may be in
  const int64_t lines_;   // their rows of cells
  const int64_t column_;  // numbers of a column of pixels: (bins + 1, lines), the last bin being the first one again
  float *histograms_, *row_weights_, *cells_, *block_;
};

// All blocks of a region, to out (columns, rows, numbers)
inline void block_grid(const PaddedImage& image, const nablahog_tables& tables, const Scheme& scheme,
                       const Region& region, float* out) {
  thread_local Workspace memory;
  memory.clear();
  const int64_t cols = scheme.block_cols(region.width), rows = scheme.block_rows(region.height);
  RowVotes votes(image, tables, region, memory);
  BlockRows blocks(scheme, region, memory);
  for (int64_t y = 0; y < region.height; ++y) {
    votes.compute(y);
    blocks.add(votes, y);
    const int64_t k = blocks.completed(y);
    if (k < 0) continue;
    for (int64_t col = 0; col < cols; ++col) blocks.block(k, col, out + (col * rows + k) * scheme.numbers());
    blocks.clear(k);
  }
}

}  // namespace nablahog::opencv
