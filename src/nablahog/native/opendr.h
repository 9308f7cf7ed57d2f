// OpenDR's approximate derivative: silhouettes drawn over the samples, then the image and its gradient.  The rule is in
// nablahog/render/pipeline.py.
#pragma once

#include <vector>

#include "screen.h"

namespace nablahog::rendering {
namespace opendr {

// Draws silhouette edges one sample wide, with brightness and 1 / depth of the surface in front.  `drawn` (height,
// width), 0 at first, is above 0 there.
inline void draw_silhouettes(const Samples& samples, const uint8_t* silhouette, const std::vector<Crossing>& crossings,
                             int32_t* drawn) {
  struct Source {
    int64_t to;
    float brightness, inverse;
  };
  std::vector<Source> sources;
  for (const Crossing& crossing : crossings) {
    if (!crossing.measured || !silhouette[crossing.edge]) continue;
    const int64_t here = crossing.row * samples.width + crossing.col;
    const int64_t there = here + (crossing.axis == 0 ? samples.width : 1);
    const int64_t front = samples.inverse[there] > samples.inverse[here] ? there : here;
    const int64_t to = crossing.at >= 0.5f ? there : here;
    // of several silhouettes through one sample the nearest is visible
    if (drawn[to] == 0 || samples.inverse[front] > sources[drawn[to] - 1].inverse) {
      sources.push_back({to, samples.brightness[front], samples.inverse[front]});
      drawn[to] = int32_t(sources.size());
    }
  }
  for (size_t n = 0; n < sources.size(); ++n) {
    const auto& [to, brightness, inverse] = sources[n];
    if (drawn[to] != int32_t(n + 1)) continue;
    samples.brightness[to] = brightness;
    samples.inverse[to] = inverse;
  }
}

// The derivative along a line of samples, `count` of them `stride` apart, at the k-th: the mean of the one-sided
// differences that touch no silhouette; if both do, twice the central difference.
inline float difference(const float* line, const int32_t* drawn, int64_t k, int64_t count, int64_t stride) {
  const float* at = line + k * stride;
  const int32_t* on = drawn + k * stride;
  const bool first = k == 0, last = k + 1 == count;
  const float before = first ? 0 : at[0] - at[-stride], after = last ? 0 : at[stride] - at[0];
  const bool has_before = !first && on[0] == 0 && on[-stride] == 0, has_after = !last && on[0] == 0 && on[stride] == 0;
  if (has_before && has_after) return (before + after) * 0.5f;
  if (has_before) return before;
  if (has_after) return after;
  return before + after;  // the central difference is half of this sum, and counts twice
}

// Sets each pixel of the box to the mean of its samples, and its gradient to the mean of theirs.
inline void resolve(const Samples& samples, const int32_t* drawn, const Pixels& pixels) {
  const int64_t step = pixels.step, width = samples.width, plane = pixels.height * pixels.width;
  const float side = 1 / float(step);
  for (int64_t row = 0; row < pixels.rows; ++row) {
    for (int64_t col = 0; col < pixels.cols; ++col) {
      float total = 0, by_x = 0, by_x_depth = 0, by_y = 0, by_y_depth = 0;
      for (int64_t i = row * step; i < row * step + step; ++i) {
        for (int64_t j = col * step; j < col * step + step; ++j) {
          const float* brightness = samples.brightness;
          total += brightness[i * width + j];
          const float w = samples.inverse[i * width + j];
          if (!pixels.screen_gradient || w <= 0) continue;
          const float along_x = difference(brightness + i * width, drawn + i * width, j, width, 1);
          const float along_y = difference(brightness + j, drawn + j, i, samples.height, width);
          by_x -= along_x;
          by_x_depth -= along_x * w;
          by_y -= along_y;
          by_y_depth -= along_y * w;
        }
      }
      const int64_t at = (pixels.top + row) * pixels.width + pixels.left + col;
      pixels.image[at] = total * side * side;
      if (!pixels.screen_gradient) continue;
      float* gradient = pixels.screen_gradient + at;
      gradient[0] = side * by_x;
      gradient[plane] = side * by_x_depth;
      gradient[2 * plane] = side * by_y;
      gradient[3 * plane] = side * by_y_depth;
    }
  }
}

}  // namespace opendr
}  // namespace nablahog::rendering
