// Descriptors and scores of windows.
#pragma once

#include <cstring>
#include <map>
#include <utility>
#include <vector>

#include "opencv_blocks.h"

namespace nablahog::opencv {

// Upper left corner of a window, in pixels of the padded image
struct Corner {
  int64_t x, y;
};

// Blocks (columns, rows, numbers) that serve some windows
struct Grid {
  std::vector<float> blocks;     // and a vector more
  int64_t column;                // numbers of a column
  std::vector<int64_t> windows;  // their numbers
  std::vector<int64_t> starts;   // where they begin
};

// Calls of_grid(grid) for all windows: a grid serves those that are whole strides of blocks apart
template <class OfGrid>
void for_grids(const PaddedImage& image, const Scheme& scheme, const PoolingWeights& weights, const Corner* corners,
               int64_t count, OfGrid of_grid) {
  std::map<std::pair<int64_t, int64_t>, std::vector<int64_t>> alike;
  for (int64_t i = 0; i < count; ++i) alike[{corners[i].x % scheme.across, corners[i].y % scheme.down}].push_back(i);
  for (auto& [offset, windows] : alike) {
    Corner low = corners[windows[0]], high = low;
    for (const int64_t i : windows) {
      low = {std::min(low.x, corners[i].x), std::min(low.y, corners[i].y)};
      high = {std::max(high.x, corners[i].x), std::max(high.y, corners[i].y)};
    }
    const Region region{low.x, low.y, high.x - low.x + scheme.window_width, high.y - low.y + scheme.window_height};
    Grid grid{{}, scheme.block_rows(region.height) * scheme.numbers(), std::move(windows), {}};
    grid.blocks.resize(scheme.block_cols(region.width) * grid.column + lanes<float>);
    block_grid(image, scheme, weights, region, grid.blocks.data());
    for (const int64_t i : grid.windows) {
      const int64_t col = (corners[i].x - low.x) / scheme.across, row = (corners[i].y - low.y) / scheme.down;
      grid.starts.push_back(col * grid.column + row * scheme.numbers());
    }
    of_grid(grid);
  }
}

// To out (windows, columns of blocks, rows of blocks · numbers)
inline void descriptors(const PaddedImage& image, const Scheme& scheme, const PoolingWeights& weights,
                        const Corner* corners, int64_t count, float* out) {
  const int64_t cols = scheme.block_cols(scheme.window_width);
  const int64_t run = scheme.block_rows(scheme.window_height) * scheme.numbers();
  for_grids(image, scheme, weights, corners, count, [&](const Grid& grid) {
    for (size_t i = 0; i < grid.windows.size(); ++i) {
      for (int64_t col = 0; col < cols; ++col)
        std::memcpy(out + (grid.windows[i] * cols + col) * run, grid.blocks.data() + grid.starts[i] + col * grid.column,
                    run * sizeof(float));
    }
  });
}

// Dot products of COUNT windows with weights (cols, run), run being whole vectors, to out.  Each column of blocks is
// added up for itself, so that rounding errors do not grow with the length of all.
template <int COUNT>
void dot_products(const float* blocks, const int64_t* starts, int64_t column, const float* weights, int64_t cols,
                  int64_t run, float* out) {
  using V = Vec<float>;
  V totals[COUNT] = {};
  for (int64_t col = 0; col < cols; ++col) {
    V sums[COUNT] = {};
    for (int64_t k = 0; k < run; k += lanes<float>) {
      const V weight = load<V>(weights + col * run + k);
      NABLAHOG_UNROLL
      for (int j = 0; j < COUNT; ++j)
        sums[j] = multiply_add(load<V>(blocks + starts[j] + col * column + k), weight, sums[j]);
    }
    NABLAHOG_UNROLL
    for (int j = 0; j < COUNT; ++j) totals[j] += sums[j];
  }
  NABLAHOG_UNROLL
  for (int j = 0; j < COUNT; ++j) out[j] = sum(totals[j]);
}

// Dot products of descriptors with coefficients, to out (windows,)
inline void scores(const PaddedImage& image, const Scheme& scheme, const PoolingWeights& weights, const Corner* corners,
                   int64_t count, const float* coefficients, float* out) {
  constexpr int64_t at_once = 4;
  const int64_t cols = scheme.block_cols(scheme.window_width);
  const int64_t run = scheme.block_rows(scheme.window_height) * scheme.numbers(), padded = round_up(run, lanes<float>);
  std::vector<float> whole(cols * padded);
  for (int64_t col = 0; col < cols; ++col)
    std::memcpy(whole.data() + col * padded, coefficients + col * run, run * sizeof(float));
  for_grids(image, scheme, weights, corners, count, [&](const Grid& grid) {
    const int64_t size = int64_t(grid.windows.size());
    const auto products = [&]<int COUNT>(int64_t i) {
      float some[COUNT];
      dot_products<COUNT>(grid.blocks.data(), grid.starts.data() + i, grid.column, whole.data(), cols, padded, some);
      for (int j = 0; j < COUNT; ++j) out[grid.windows[i + j]] = some[j];
    };
    int64_t i = 0;
    for (; i + at_once <= size; i += at_once) products.template operator()<at_once>(i);
    for (; i < size; ++i) products.template operator()<1>(i);
  });
}

}  // namespace nablahog::opencv
