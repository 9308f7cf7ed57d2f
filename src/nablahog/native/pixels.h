// Samples to pixels: their brightness, then anti-aliased edges, or OpenDR's rule.  The derivative of pixels is by the
// motion of surfaces: at 1 / depth = w they move by (a_x + b_x w, a_y + b_y w) pixels, and the gradient's four channels
// are by a_x, b_x, a_y, b_y.
#pragma once

#include <algorithm>
#include <vector>

#include "rasterize.h"

namespace nablahog::rendering {

// Brightness of samples: perspective-correct interpolation between the corners of a triangle

// How brightness varies in a triangle.  (brightness - that of the first corner) / depth is linear on the screen.
struct BrightnessPlane {
  float by_x, by_y;  // its derivatives
  float x, y;        // of the first corner, less half a sample
  float first;       // brightness there
  float least, most;
};

inline BrightnessPlane brightness_plane(const Point<float>* screen, const Face& face,
                                        const std::array<float, 3>& corners) {
  const auto [va, vb, vc] = corners;
  const Point<float>&a = screen[face[0]], &b = screen[face[1]], &c = screen[face[2]];
  const float xb = b[0] - a[0], yb = b[1] - a[1], xc = c[0] - a[0], yc = c[1] - a[1];
  const float qb = (vb - va) * b[2], qc = (vc - va) * c[2];
  const float area = xb * yc - xc * yb;
  return {(qb * yc - qc * yb) / area,     (xb * qc - xc * qb) / area,    a[0] - 0.5f, a[1] - 0.5f, va,
          std::min(std::min(va, vb), vc), std::max(std::max(va, vb), vc)};
}

// Sets the brightness of rasterised samples, the background's where there is no triangle.  Scratch of one entry a
// face: `known`, zeros, and `planes`.
inline void shade(const Point<float>* screen, const Face* faces, const std::array<float, 3>* brightness,
                  const Pixels& pixels, uint8_t* known, BrightnessPlane* planes, const Samples& samples) {
  for (int64_t i = 0; i < samples.height; ++i) {
    const int32_t* ids = samples.ids + i * samples.width;
    const float* inverse = samples.inverse + i * samples.width;
    float* out = samples.brightness + i * samples.width;
    const float* behind = pixels.image + (pixels.top + i / pixels.step) * pixels.width + pixels.left;
    for (int64_t first = 0; first < samples.width; first += pixels.step, ++behind) {
      for (int64_t j = first; j < first + pixels.step; ++j) {
        const int32_t f = ids[j];
        if (f < 0) {
          out[j] = *behind;
          continue;
        }
        BrightnessPlane& plane = planes[f];
        if (!known[f]) {
          known[f] = 1;
          plane = brightness_plane(screen, faces[f], brightness[f]);
        }
        const float along = plane.by_x * (float(j) - plane.x) + plane.by_y * (float(i) - plane.y);
        out[j] = std::min(std::max(plane.first + along / inverse[j], plane.least), plane.most);
      }
    }
  }
}

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

// OpenDR's approximate derivative: silhouettes drawn over the samples, then the image and its gradient.  The rule is in
// nablahog/render/pipeline.py.
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
