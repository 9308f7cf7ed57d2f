// Regions of an image that are constant.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace nablahog {

// Pixels first … end - 1 of one region, in a row
using Run = std::array<int64_t, 3>;  // first, end, region

// Sets the pixels of each region to their mean.  `sizes` (regions,) are the numbers of pixels.
template <class T>
void level(T* image, const Run* runs, int64_t count, const double* sizes, double* sums) {
  for (int64_t k = 0; k < count; ++k) {
    const auto [first, end, region] = runs[k];
    double total = 0;
    for (int64_t x = first; x < end; ++x) total += image[x];
    sums[region] += total;
  }
  for (int64_t k = 0; k < count; ++k) {
    const auto [first, end, region] = runs[k];
    std::fill(image + first, image + end, T(sums[region] / sizes[region]));
  }
}

}  // namespace nablahog
