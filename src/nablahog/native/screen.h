// What the renderer's loops pass to each other.  Brightness, samples and pixels are in rows.
#pragma once

#include <array>
#include <cstdint>

namespace nablahog::rendering {

// A vertex on the screen: x and y in samples, sample (row i, column j) being at (j + ½, i + ½), and w = 1 / depth.
// What has a vertex with w = 0 is not drawn.
template <class T>
using Point = std::array<T, 3>;

// Of each corner, the vertex
using Face = std::array<int32_t, 3>;

// Samples of a box in the image
struct Samples {
  int64_t height, width;
  int32_t* ids;       // (height, width), the triangle, -1 for the background
  float* inverse;     // (height, width), 1 / depth, 0 for the background
  float* brightness;  // (height, width)
};

// One image, and the box in it that samples are taken of
struct Pixels {
  int64_t height, width;
  int64_t top, left;       // first pixel of the box
  int64_t rows, cols;      // of the box
  int64_t step;            // samples of a pixel along a side
  float* image;            // (height, width), holds the background at first
  float* screen_gradient;  // (4, height, width), or null: see nablahog/render/renderer.py
};

// A link between neighbouring samples that a visible edge crosses, from sample (row, col) down (axis 0) or right (1)
struct Crossing {
  int32_t axis, row, col;
  int32_t edge;
  float at;       // where on the link, 0…1
  float slope;    // samples along the link that the edge advances for each sample across it
  float w;        // 1 / depth of the edge
  bool measured;  // on the axis across which the edge runs; on the other it only marks the link
};

}  // namespace nablahog::rendering
