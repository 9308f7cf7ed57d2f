// The loops of compat/opencv: descriptors and scores of windows, and images at other scales.
#include <cstring>
#include <map>
#include <utility>
#include <vector>

#include "interface.h"
#include "opencv_blocks.h"
#include "vec.h"

namespace nablahog::opencv {

// Upper left corner of a window, in pixels of the padded image
struct Corner {
  int64_t x, y;
};

// Blocks (columns, rows, numbers) that serve some windows
struct Grid {
  std::vector<float> blocks;     // with room for a vector more
  int64_t column;                // numbers of a column
  std::vector<int64_t> windows;  // their numbers
  std::vector<int64_t> starts;   // where they begin
};

// Calls of_grid(grid) for all windows: a grid serves those that are whole strides of blocks apart
template <class OfGrid>
void for_grids(const PaddedImage& image, const nablahog_tables& tables, const Scheme& scheme, const Corner* corners,
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
    block_grid(image, tables, scheme, region, grid.blocks.data());
    for (const int64_t i : grid.windows) {
      const int64_t col = (corners[i].x - low.x) / scheme.across, row = (corners[i].y - low.y) / scheme.down;
      grid.starts.push_back(col * grid.column + row * scheme.numbers());
    }
    of_grid(grid);
  }
}

// To out (windows, columns of blocks, rows of blocks · numbers)
inline void descriptors(const PaddedImage& image, const nablahog_tables& tables, const Scheme& scheme,
                        const Corner* corners, int64_t count, float* out) {
  const int64_t cols = scheme.block_cols(scheme.window_width);
  const int64_t run = scheme.block_rows(scheme.window_height) * scheme.numbers();
  for_grids(image, tables, scheme, corners, count, [&](const Grid& grid) {
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
inline void scores(const PaddedImage& image, const nablahog_tables& tables, const Scheme& scheme, const Corner* corners,
                   int64_t count, const float* coefficients, float* out) {
  constexpr int64_t at_once = 4;
  const int64_t cols = scheme.block_cols(scheme.window_width);
  const int64_t run = scheme.block_rows(scheme.window_height) * scheme.numbers(), padded = round_up(run, lanes<float>);
  std::vector<float> whole(cols * padded);
  for (int64_t col = 0; col < cols; ++col)
    std::memcpy(whole.data() + col * padded, coefficients + col * run, run * sizeof(float));
  for_grids(image, tables, scheme, corners, count, [&](const Grid& grid) {
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

// Of a resized axis: the pixels to interpolate from, and the weights of those behind them in 1/256
struct Axis {
  int64_t size;
  const int32_t *before, *weight;
};

// Images at other scales, byte by byte those of cv2.resize(…, interpolation=cv2.INTER_LINEAR_EXACT): weights are
// multiples of 1/256, and only the result is rounded.  An image of rows of `line` bytes to out (rows, columns,
// CHANNELS)
template <int CHANNELS>
void resize(const uint8_t* image, int64_t line, const Axis& rows, const Axis& cols, uint8_t* out) {
  using Pixel = Vec<int32_t, 4>;
  std::vector<int32_t> between(line + CHANNELS + size<Pixel>);
  for (int64_t y = 0; y < rows.size; ++y) {
    const uint8_t* upper = image + rows.before[y] * line;
    const uint8_t* lower = rows.weight[y] ? upper + line : upper;
    for (int64_t k = 0; k < line; ++k) between[k] = upper[k] * (256 - rows.weight[y]) + lower[k] * rows.weight[y];
    for (int64_t x = 0; x < cols.size; ++x, out += CHANNELS) {
      const int32_t* from = between.data() + cols.before[x] * CHANNELS;
      const int32_t weight = cols.weight[x];
      const Pixel value = load<Pixel>(from) * (256 - weight) + load<Pixel>(from + CHANNELS) * weight + (1 << 15);
      const auto bytes = (Vec<uint8_t, 16>)value;
      const auto rounded = __builtin_shufflevector(bytes, bytes, 2, 6, 10, 14);  // value / 2^16
      std::memcpy(out, &rounded, CHANNELS);
    }
  }
}

}  // namespace nablahog::opencv

using namespace nablahog;

// To arrays (padded_height, padded_width, 2)
NABLAHOG_API int nablahog_opencv_votes(const opencv::PaddedImage* image, const nablahog_tables* tables, float* votes,
                                       uint8_t* bins) {
  return guarded([&] { opencv::votes(*image, *tables, votes, bins); });
}

// Of windows at corners (count, 2), x and y
NABLAHOG_API int nablahog_opencv_descriptors(const opencv::PaddedImage* image, const nablahog_tables* tables,
                                             const opencv::Scheme* scheme, const opencv::Corner* corners, int64_t count,
                                             float* out) {
  return guarded([&] { opencv::descriptors(*image, *tables, *scheme, corners, count, out); });
}

NABLAHOG_API int nablahog_opencv_scores(const opencv::PaddedImage* image, const nablahog_tables* tables,
                                        const opencv::Scheme* scheme, const opencv::Corner* corners, int64_t count,
                                        const float* coefficients, float* out) {
  return guarded([&] { opencv::scores(*image, *tables, *scheme, corners, count, coefficients, out); });
}

// An image (…, width, channels) of 1 or 3 channels to out (rows, cols, channels)
NABLAHOG_API int nablahog_opencv_resize(const uint8_t* image, int64_t width, int64_t channels, int64_t rows,
                                        const int32_t* row_low, const int32_t* row_weight, int64_t cols,
                                        const int32_t* col_low, const int32_t* col_weight, uint8_t* out) {
  return guarded([&] {
    const auto resize = channels == 3 ? opencv::resize<3> : opencv::resize<1>;
    resize(image, width * channels, {rows, row_low, row_weight}, {cols, col_low, col_weight}, out);
  });
}
