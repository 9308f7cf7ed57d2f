// Samples to pixels, with anti-aliased edges, and the derivative of pixels by the motion of surfaces: at 1 / depth = w
// they move by (a_x + b_x w, a_y + b_y w) pixels, and the gradient's four channels are by a_x, b_x, a_y, b_y.
#pragma once

#include <algorithm>
#include <vector>

#include "screen.h"

namespace nablahog::rendering {
namespace antialiasing {

// Adds the gradient of links without an edge, from the samples of row i along one axis.  There the boundary is half-way
// between two samples, and both of them change.  Short loops, which compilers turn into vector instructions.
//
// sums: of both channels, for the row of pixels of the links' first samples and for that of their second ones; links:
// scratch (2, width), differences of brightness, and the same times 1 / depth.
template <int AXIS>
void add_link_gradients(const Samples& samples, const int32_t* number, int64_t i, float* links, float* const sums[2],
                        float* const next_sums[2]) {
  const int64_t width = samples.width, here = i * width, there = AXIS == 0 ? here + width : here + 1;
  const int64_t count = width - AXIS;
  const float *brightness = samples.brightness, *inverse = samples.inverse;
  const int32_t *ids = samples.ids, *crossed = number + (AXIS * samples.height + i) * width;
  float* __restrict difference = links, * __restrict deep_difference = links + width;
  for (int64_t j = 0; j < count; ++j) {
    const float d = brightness[there + j] - brightness[here + j];
    difference[j] = crossed[j] == 0 ? d : 0;
  }
  for (int64_t j = 0; j < count; ++j) {
    const float w = inverse[here + j], w2 = inverse[there + j], nearer = std::max(w, w2), middle = 0.5f * (w + w2);
    const float front = ids[here + j] == ids[there + j] ? middle : nearer, d = difference[j];
    difference[j] = front > 0 ? d : 0;
    deep_difference[j] = d * front;
  }
  for (int k = 0; k < 2; ++k) {
    const float* __restrict change = links + k * width;
    float* __restrict first = sums[k], *second = next_sums[k] + AXIS;
    for (int64_t j = 0; j < count; ++j) first[j] -= change[j];
    for (int64_t j = 0; j < count; ++j) second[j] -= change[j];
  }
}

// Moves the boundary of links with an edge to where the edge crosses, and adds its gradient.
inline void add_crossings(const Samples& samples, const std::vector<Crossing>& crossings, const Pixels& pixels) {
  const float side = 1 / float(pixels.step), share = side * side;
  const int64_t plane = pixels.height * pixels.width;
  for (const Crossing& crossing : crossings) {
    if (!crossing.measured) continue;
    const int32_t i = crossing.row, j = crossing.col, i2 = i + 1 - crossing.axis, j2 = j + crossing.axis;
    float d = samples.brightness[i2 * samples.width + j2] - samples.brightness[i * samples.width + j];
    const bool after = crossing.at >= 0.5f;
    const int64_t y = pixels.top + (after ? i2 : i) / pixels.step, x = pixels.left + (after ? j2 : j) / pixels.step;
    const int64_t at = y * pixels.width + x;
    pixels.image[at] += (0.5f - crossing.at) * d * share;
    if (!pixels.screen_gradient) continue;
    float* along = pixels.screen_gradient + (crossing.axis == 0 ? 2 * plane : 0) + at;
    float* across = pixels.screen_gradient + (crossing.axis == 0 ? 0 : 2 * plane) + at;
    d *= side;
    along[0] -= d;
    along[plane] -= d * crossing.w;
    d *= crossing.slope;
    across[0] += d;
    across[plane] += d * crossing.w;
  }
}

// Sums `step` neighbours each on a line, times a factor.
inline void pool(const float* line, int64_t step, int64_t count, float factor, float* out) {
  if (step == 1) {
    for (int64_t x = 0; x < count; ++x) out[x] = factor * line[x];
    return;
  }
  for (int64_t x = 0; x < count; ++x, line += step) {
    float total = 0;
    for (int64_t k = 0; k < step; ++k) total += line[k];
    out[x] = factor * total;
  }
}

}  // namespace antialiasing

// Sets each pixel of the box to the mean of its samples, with each visible edge where it crosses between samples.
// `scratch` is of 12 lines of samples, zeros.
inline void antialias(const Samples& samples, const int32_t* number, const std::vector<Crossing>& crossings,
                      const Pixels& pixels, float* scratch) {
  using namespace antialiasing;
  const int64_t width = samples.width, step = pixels.step, plane = pixels.height * pixels.width;
  const float side = 1 / float(step);
  // for this row of pixels and the next, sample by sample: brightness, and the four channels of the gradient
  float* sums[5];
  float* next[5];
  for (int k = 0; k < 5; ++k) sums[k] = scratch + k * width, next[k] = scratch + (5 + k) * width;
  float* links = scratch + 10 * width;
  for (int64_t row = 0; row < pixels.rows; ++row) {
    for (int64_t i = row * step; i < row * step + step; ++i) {
      const float* line = samples.brightness + i * width;
      for (int64_t j = 0; j < width; ++j) sums[0][j] += line[j];
      if (!pixels.screen_gradient) continue;
      const bool last = i + 1 == row * step + step;
      if (i + 1 < samples.height) add_link_gradients<0>(samples, number, i, links, sums + 3, (last ? next : sums) + 3);
      add_link_gradients<1>(samples, number, i, links, sums + 1, sums + 1);
    }
    const int64_t at = (pixels.top + row) * pixels.width + pixels.left;
    pool(sums[0], step, pixels.cols, side * side, pixels.image + at);
    if (pixels.screen_gradient) {
      float* gradient = pixels.screen_gradient + at;
      for (int k = 0; k < 4; ++k) pool(sums[1 + k], step, pixels.cols, 0.5f * side, gradient + k * plane);
    }
    for (int k = 0; k < 5; ++k) {
      std::fill_n(sums[k], width, 0.f);
      std::swap(sums[k], next[k]);
    }
  }
  add_crossings(samples, crossings, pixels);
}

}  // namespace nablahog::rendering
