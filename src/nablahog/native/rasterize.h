// What the renderer's loops pass to each other, and rasterisation with a depth buffer: the nearest triangle at each
// sample.  Brightness, samples and pixels are in rows.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "vec.h"
#include "workspace.h"

namespace nablahog::rendering {

// A vertex on the screen: x and y in samples, sample (row i, column j) being at (j + ½, i + ½), and w = 1 / depth.
// Triangles and edges with a vertex at w = 0 are not drawn.
template <class T>
using Point = std::array<T, 3>;

// The vertices of each triangle's corners
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

// Of the rows and columns with a sample in a bounding box: minus the first row, the last, minus the first column, the
// last; clamped to one beyond the image, since no integer is as large as numbers can be
using SampleBox = Vec<int32_t, 4>;

// The sample boxes of vertices; that of several is their maximum.
template <class T>
void sample_boxes(const Point<T>* screen, int64_t count, int64_t height, int64_t width, SampleBox* boxes) {
  using V = Vec<T, 4>;
  const V half = {T(0.5), T(-0.5), T(0.5), T(-0.5)};
  const V least = {-T(height), T(-1), -T(width), T(-1)}, most = {0, T(height - 1), 0, T(width - 1)};
  for (int64_t v = 0; v < count; ++v) {
    const auto [x, y, w] = screen[v];
    const V box = minimum(maximum(floor(V{-y, y, -x, x} + half), least), most);
    boxes[v] = __builtin_convertvector(box, SampleBox);
  }
}

namespace raster {

constexpr int batch = 1024;  // triangles that go through the three loops of rasterize together

template <class T>
T min(T a, T b, T c) {
  return std::min(std::min(a, b), c);
}
template <class T>
T max(T a, T b, T c) {
  return std::max(std::max(a, b), c);
}

// A triangle with a sample in its bounding box
struct Candidate {
  int32_t box[4];
  int32_t face;
};

// Samples of a triangle on one line, with 1 / depth at the first, its step to the next, its least and most
template <class T>
struct Span {
  int64_t at;
  int32_t step, count, face;
  T w, slope, least, most;
};

// Lists the triangles first…last - 1 whose bounding box has a sample; returns their number.
inline int list_triangles(const SampleBox* boxes, const Face* faces, int64_t first, int64_t last, Candidate* found) {
  int count = 0;
  for (int64_t f = first; f < last; ++f) {
    const auto [a, b, c] = faces[f];
    const SampleBox box = maximum(maximum(boxes[a], boxes[b]), boxes[c]);
    store(found[count].box, box);
    found[count].face = int32_t(f);
    count += ((box[0] + box[1]) | (box[2] + box[3])) >= 0;
  }
  return count;
}

// Samples q of a line, between which lies a triangle
struct Interval {
  double low, high;
};

// The sides of a triangle as lanes, each from one corner to the next.  They bound its samples q on the line p.
template <class T>
class Sides {
 public:
  // `turn` is 1 or -1, the triangle's orientation; `more` widens it against rounding.
  [[gnu::always_inline]] Sides(const T (&p)[3], const T (&q)[3], double turn, double more) {
    const V p0 = {p[0], p[1], p[2], p[0]}, p1 = {p[1], p[2], p[0], p[1]};
    const V q0 = {q[0], q[1], q[2], q[0]}, q1 = {q[1], q[2], q[0], q[1]};
    p_ = minimum(p0, p1);
    first_ = in_double(p_);
    last_ = in_double(maximum(p0, p1));
    // in double: of a corner millions of samples away, products would be off by a sample
    const Doubles forth = in_double(p1) - in_double(p0), aside = in_double(q1) - in_double(q0);
    slope_ = forth != 0 ? aside / forth : Doubles{};
    q_ = forth >= 0 ? in_double(q0) : in_double(q1);
    const Doubles turned = forth * turn;
    to_low_ = turned > 0 ? splat<Doubles>(-more) : -none();
    to_high_ = turned < 0 ? splat<Doubles>(more) : none();
  }

  [[gnu::always_inline]] Interval at(T p) const {
    const auto beside = (splat<Doubles>(double(p)) < first_) | (splat<Doubles>(double(p)) > last_);
    const Doubles q = q_ + in_double(splat<V>(p) - p_) * slope_ - 0.5;
    const Doubles low = beside ? -none() : q + to_low_, high = beside ? none() : q + to_high_;
    return {std::max(std::max(low[0], low[1]), low[2]), std::min(std::min(high[0], high[1]), high[2])};
  }

 private:
  using V = Vec<T, 4>;
  using Doubles = Vec<double, 4>;
  static Doubles in_double(V v) { return __builtin_convertvector(v, Doubles); }
  static Doubles none() { return splat<Doubles>(std::numeric_limits<double>::infinity()); }

  V p_;
  Doubles first_, last_;      // p at the ends
  Doubles q_, slope_;         // q at the first, dq / dp
  Doubles to_low_, to_high_;  // what to add for the bounds, infinite where a side is none
};

// Scans triangles line by line, and lists the span of samples inside them on each line.  Once there are as many spans
// as triangles in a batch, no other triangle is begun.  Sets the number of spans; returns that of triangles scanned.
template <class T>
int list_spans(const Point<T>* screen, const Face* faces, const Candidate* found, int listed, int64_t height,
               int64_t width, Span<T>* spans, int& count) {
  constexpr T half = T(0.5);
  const T large = T(std::max(height, width));
  // so much that a sample on a common edge of two triangles is in one of them, if they are not scanned alike
  const T rounding = std::numeric_limits<T>::epsilon() * 2 * large;
  int done = 0;
  count = 0;
  while (done < listed && count < batch) {
    const auto& [box, f] = found[done++];
    const Point<T>&a = screen[faces[f][0]], &b = screen[faces[f][1]], &c = screen[faces[f][2]];
    const T x_low = min(a[0], b[0], c[0]), x_high = max(a[0], b[0], c[0]);
    const T y_low = min(a[1], b[1], c[1]), y_high = max(a[1], b[1], c[1]);
    // the rounding error of a corner far away may be of any size: triangles that have one are all scanned alike
    const bool by_column = (box[1] + box[0] > box[3] + box[2]) & (y_high - y_low < large) & (x_high - x_low < large);
    // one line after the other along p, and q on each
    const int along = by_column, across = 1 - along;
    const T p[] = {a[across], b[across], c[across]}, q[] = {a[along], b[along], c[along]}, w[] = {a[2], b[2], c[2]};
    const T pb = p[1] - p[0], pc = p[2] - p[0], qb = q[1] - q[0], qc = q[2] - q[0], wb = w[1] - w[0], wc = w[2] - w[0];
    const T area = pb * qc - pc * qb;
    if (!((w[0] > 0) & (w[1] > 0) & (w[2] > 0) & (area != 0))) continue;
    const T over = 1 / area, by_p = (wb * qc - wc * qb) * over, by_q = (pb * wc - pc * wb) * over;
    const T least = min(w[0], w[1], w[2]), most = max(w[0], w[1], w[2]);
    const double low = std::max(T(0), (along ? y_low : x_low) - half);
    const double high = std::min(T((along ? height : width) - 1), (along ? y_high : x_high) - half);
    const Sides<T> sides(p, q, area > 0 ? 1 : -1, by_column ? rounding : 0);
    const int64_t step_p = along ? 1 : width, step_q = along ? width : 1;
    for (int line = -box[2 * along], end = box[2 * along + 1]; line <= end; ++line) {
      const T middle = T(line) + half;
      const Interval inside = sides.at(middle);
      // within the image, since no integer is as large as numbers can be
      const double start = std::ceil(std::min(high + 1, std::max(low, inside.low)));
      const double stop = std::floor(std::max(low - 1, std::min(high, inside.high)));
      Span<T>& span = spans[count];
      span.at = line * step_p + int(start) * step_q;
      span.step = int32_t(step_q);
      span.count = int(stop) - int(start) + 1;
      span.face = f;
      span.w = T(w[0] + by_p * (middle - p[0]) + by_q * (start - (q[0] - half)));
      span.slope = by_q;
      span.least = least;
      span.most = most;
      count += start <= stop;
    }
  }
  return done;
}

// Draws the samples k…k + N - 1 of a span of neighbours.
template <int N, class T>
[[gnu::always_inline]] inline void draw_samples(const Span<T>& span, int k, int32_t* ids, T* inverse) {
  using V = Vec<T, N>;
  ids += span.at + k;
  inverse += span.at + k;
  const V plane = span.w + span.slope * (T(k) + iota<V>());
  const V w = minimum(splat<V>(span.most), maximum(splat<V>(span.least), plane));  // NaN stays
  const V before = load<V>(inverse);
  const auto nearer = w > before;
  store(inverse, nearer ? w : before);
  const auto shown = __builtin_convertvector(nearer, Vec<int32_t, N>);
  store(ids, shown ? splat<Vec<int32_t, N>>(span.face) : load<Vec<int32_t, N>>(ids));
}

// Draws spans with a depth test.  1 / depth of a sliver has a wild slope: it stays between that of the corners.
template <class T>
void draw_spans(const Span<T>* spans, int count, int32_t* ids, T* inverse) {
  for (const Span<T>* span = spans; span < spans + count; ++span) {
    if (span->step == 1 && span->count >= 4) {
      int k = 0;
      for (; k + lanes<T> <= span->count; k += lanes<T>) draw_samples<lanes<T>>(*span, k, ids, inverse);
      for (; k + 4 <= span->count; k += 4) draw_samples<4>(*span, k, ids, inverse);
      draw_samples<4>(*span, span->count - 4, ids, inverse);  // some of them again, which changes nothing
      continue;
    }
    int64_t at = span->at;
    for (int k = 0; k < span->count; ++k, at += span->step) {
      const T w = std::min(std::max(span->w + span->slope * T(k), span->least), span->most);
      if (w > inverse[at]) {
        inverse[at] = w;
        ids[at] = span->face;
      }
    }
  }
}

}  // namespace raster

// Sets `ids` (height, width) to the triangle or -1, and `inverse` to 1 / depth or 0.  Triangles with a corner at
// 1 / depth ≤ 0 or NaN are not drawn.
template <class T>
void rasterize(const Point<T>* screen, const SampleBox* boxes, const Face* faces, int64_t face_count, int64_t height,
               int64_t width, int32_t* ids, T* inverse) {
  using namespace raster;
  std::fill_n(ids, height * width, -1);
  std::fill_n(inverse, height * width, T(0));
  thread_local Workspace memory;
  memory.clear();
  Candidate* found = memory.uninitialized<Candidate>(batch);
  Span<T>* spans = memory.uninitialized<Span<T>>(batch + std::max(height, width));
  // Three loops over a batch of triangles.  Which triangles have samples, on how many lines, and how many on each, is
  // hard to predict: a mispredicted branch in one loop must not wait for the arithmetic that it depends on.
  for (int64_t first = 0; first < face_count; first += batch) {
    const int listed = list_triangles(boxes, faces, first, std::min(first + batch, face_count), found);
    for (int done = 0, count; done < listed;) {
      done += list_spans(screen, faces, found + done, listed - done, height, width, spans, count);
      draw_spans(spans, count, ids, inverse);
    }
  }
}

// The same of `count` images, with points (count, point_count, 3).
template <class T>
void rasterize_images(const Point<T>* screen, int64_t count, int64_t point_count, const Face* faces, int64_t face_count,
                      int64_t height, int64_t width, int32_t* ids, T* inverse) {
  thread_local Workspace memory;
  memory.clear();
  SampleBox* boxes = memory.uninitialized<SampleBox>(point_count);
  for (int64_t b = 0; b < count; ++b) {
    sample_boxes(screen, point_count, height, width, boxes);
    rasterize(screen, boxes, faces, face_count, height, width, ids, inverse);
    screen += point_count;
    ids += height * width;
    inverse += height * width;
  }
}

}  // namespace nablahog::rendering
