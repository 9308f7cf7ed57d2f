// Brightness of samples: perspective-correct interpolation between the corners of a triangle.
#pragma once

#include <algorithm>

#include "screen.h"

namespace nablahog::rendering {

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

}  // namespace nablahog::rendering
