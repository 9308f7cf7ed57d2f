// Images at other scales, byte by byte those of cv2.resize(…, interpolation=cv2.INTER_LINEAR_EXACT): weights are
// multiples of 1/256, and only the result is rounded.
#pragma once

#include <vector>

#include "vec.h"

namespace nablahog::opencv {

// Of a resized axis: the pixels to interpolate from, and the weights of those behind them in 1/256
struct Axis {
  int64_t size;
  const int32_t *before, *weight;
};

// An image of rows of `line` bytes to out (rows, columns, CHANNELS)
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
